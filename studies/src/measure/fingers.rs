//! One twin with many fingers.

use super::twin::{Twin, model};
use crate::testbed::Testbed;
use anyhow::Context;
use runtime::config::Scene;
use runtime::source::SourceSpec;
use serde_json::{Value, json};
use softtwin::output;
use softtwin::resources;
use std::time::{Duration, Instant};

/// Processor time and latency of one twin with many fingers, each with its own readings at 1 kHz, its state and its tip.
#[derive(clap::Args)]
pub struct Args {
    /// Actuators in the twin.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u16).range(1..=100))]
    fingers: u16,
    /// Seconds of the measurement.
    #[arg(long, value_name = "S", default_value_t = 20.0, value_parser = softtwin::range::seconds)]
    seconds: f64,
}

/// Time after which all topics are open and the first health reports are there.
const SETTLED: Duration = Duration::from_secs(3);

impl Args {
    /// Measures and prints.
    pub fn run(self) -> anyhow::Result<()> {
        let testbed = Testbed::new("fingers")?;
        let scene = testbed.write("scene.toml", toml::to_string(&self.scene()?)?)?;
        let twin = Twin::start(testbed, &scene, &[], &[])?;
        let process = twin.twin.id().to_string();
        std::thread::sleep(SETTLED);
        let before = rows(&twin)?;
        let (cpu_s, begin) = (resources::cpu_s(&process), Instant::now());
        std::thread::sleep(Duration::from_secs_f64(self.seconds));
        let (elapsed_s, used_s) = (begin.elapsed().as_secs_f64(), resources::cpu_s(&process));
        let after = rows(&twin)?;
        let count = |of: &dyn Fn(&Value) -> Option<u64>| {
            let sum = |rows: &[Value]| rows.iter().filter_map(of).sum::<u64>();
            sum(&after).saturating_sub(sum(&before))
        };
        let per_second = |count: u64| (count as f64 / elapsed_s).round();
        output::json(&json!({
            "fingers": after.len(),
            "seconds": elapsed_s,
            "share_of_a_core": used_s.zip(cpu_s).map(|(used, before)| (used - before) / elapsed_s),
            "readings_per_second": per_second(count(&|row| row["received"].as_u64())),
            "answered_per_second": per_second(count(&|row| row["outcomes"]["published"].as_u64())),
            "missed": count(&|row| row["missed"].as_u64()),
            "latency_p99_us": after.iter().filter_map(|row| row["latency_p99_us"].as_f64()).fold(0.0, f64::max),
        }))?;
        twin.stop()
    }

    /// The controller's scene with more than one finger.
    fn scene(&self) -> anyhow::Result<Scene> {
        let mut scene = Scene::load("config/scenes/control.toml".as_ref())?;
        let finger = scene.actuators.pop().context("the controller's scene has a finger")?;
        let model = model()?;
        scene.actuators = (1..=self.fingers)
            .map(|n| {
                let mut finger = finger.clone();
                (finger.name, finger.model) = (format!("finger{n}"), model.clone());
                if let Some(SourceSpec::Simulate(source)) = &mut finger.source {
                    source.seed = n.into();
                }
                finger
            })
            .collect();
        Ok(scene)
    }
}

fn rows(twin: &Twin) -> anyhow::Result<Vec<Value>> {
    Ok(serde_json::from_str(&twin.testbed.run("softtwin", &["top", "--once", "--json"])?)?)
}
