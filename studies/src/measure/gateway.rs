//! Throughput and cost of the network gateway, on loopback.

use super::twin::{Duration, Twin, model, print};
use crate::python;
use crate::stats::median;
use crate::testbed::{Sine, Testbed};
use anyhow::Context;
use serde_json::{Value, json};
use softtwin::daemon::{Daemon, program};
use softtwin::resources;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::atomic::AtomicBool;
use std::time::Instant;

/// States lost and fields a second at a remote subscriber, and the twin's latency without gateway, with one, and with one that
/// is listened to.
#[derive(clap::Args)]
#[command(
    after_help = "Needs softtwin-gateway beside this program, Python 3.9 or newer with venv, and PyPI the first time."
)]
pub struct Args {
    #[command(flatten)]
    time: Duration,
    /// How often all three situations are measured.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=1000))]
    rounds: u16,
    /// Run the twin as an ordinary program, without real-time settings.
    #[arg(long)]
    no_realtime: bool,
}

const ENDPOINT: &str = "tcp/127.0.0.1:17447";
/// Real-time settings that config/systemd/softtwin-twin@.service allows; refused ones are printed.
const REALTIME: &str =
    "[realtime]\nlock_memory = true\nprefault = true\nfifo_priority = 50\nstay_awake = true\n";
/// A niceness as in the gateway's unit: the twin comes first.
const NICE: &str = "5";
/// The situations, measured in turn, so that a drift of the machine affects all of them.
const PHASES: [&str; 3] = ["twin alone", "gateway, no subscriber", "gateway, one subscriber"];

impl Args {
    /// Measures and prints.
    pub fn run(self) -> anyhow::Result<()> {
        let python = python::environment("gateway", &["eclipse-zenoh==1.10.2", "numpy", "pytest"])?;
        let testbed = Testbed::new("gateway")?;
        let readings =
            Sine { rate_hz: 1000.0, gap_mm: 30.0, mean_mpa: 0.045, amplitude_mpa: 0.03, frequency_hz: 0.5 };
        let scene = readings.scene("finger", &model()?, "", &["nodes = \"surface\"".into()]);
        let scene = testbed.write("scene.toml", scene)?;
        let settings = testbed.write("twin.toml", if self.no_realtime { "" } else { REALTIME })?;
        let config =
            testbed.write("gateway.toml", format!("listen = [\"{ENDPOINT}\"]\nfield_rate_hz = 30.0\n"))?;
        let mut twin = Twin::start(testbed, &scene, &["--config".as_ref(), settings.as_ref()], &[])?;
        let refused = |log: String| {
            let lines = log.lines().filter_map(|line| line.split_once("ASKED FOR: "));
            lines.map(|(_, what)| what.to_owned()).collect::<Vec<_>>()
        };
        print(
            "machine",
            json!({ "realtime": !self.no_realtime, "twin_was_refused": refused(twin.twin.log()) }),
        )?;
        let mut study = Study { twin, config, python, seconds: self.time.seconds, found: Default::default() };
        for _ in 0..self.rounds {
            study.round()?;
        }
        study.note(0, None)?;
        for (phase, rounds) in PHASES.iter().zip(&study.found) {
            print(&format!("all rounds: {phase}"), summary(rounds))?;
        }
        study.twin.stop()
    }
}

struct Study {
    twin: Twin,
    config: PathBuf,
    python: PathBuf,
    seconds: f64,
    /// Health reports by situation and round.
    found: [Vec<Vec<Value>>; 3],
}

impl Study {
    fn round(&mut self) -> anyhow::Result<()> {
        self.note(0, None)?;
        let mut command = self.twin.testbed.command("nice".as_ref());
        command.args(["-n", NICE]).arg(program("softtwin-gateway")?).arg("--config").arg(&self.config);
        let mut gateway = Daemon::start("gateway", command.stdout(Stdio::null()))?;
        gateway.wait_ready(&AtomicBool::new(false))?;
        self.note(1, Some(&gateway))?;
        let subscriber = Command::new(&self.python)
            .args(["studies/python/gateway_subscriber.py", ENDPOINT])
            .arg((self.seconds + 2.0).to_string())
            .stdout(Stdio::piped())
            .spawn()?;
        std::thread::sleep(std::time::Duration::from_secs(1)); // Python starts: not part of the measurement
        self.note(2, Some(&gateway))?;
        let received = subscriber.wait_with_output()?;
        let received: Value = serde_json::from_slice(&received.stdout).context("the subscriber failed")?;
        print("remote subscriber", received)?;
        gateway.stop()
    }

    fn note(&mut self, phase: usize, gateway: Option<&Daemon>) -> anyhow::Result<()> {
        let cpu_s = || resources::cpu_s(&gateway?.id().to_string());
        let (before, begin) = (cpu_s(), Instant::now());
        let mut reports = self.twin.health((self.seconds as usize).max(2))?;
        reports.remove(0); // covers time before this measurement
        let elapsed_s = begin.elapsed().as_secs_f64();
        let share = cpu_s().zip(before).map(|(after, before)| (after - before) / elapsed_s);
        self.found[phase].push(reports);
        let rounds = &self.found[phase];
        let mut result = summary(&rounds[rounds.len() - 1..]);
        result["round"] = json!(rounds.len());
        result["gateway_share_of_a_core"] = json!(share);
        print(PHASES[phase], result)
    }
}

/// Medians over all reports, and the least and largest median of a round.
fn summary(rounds: &[Vec<Value>]) -> Value {
    let mut result = json!({ "reports": rounds.iter().map(Vec::len).sum::<usize>() });
    for key in ["latency_p50", "latency_p99", "compute_p99"] {
        let us = |report: &Value| report[format!("{key}_ns")].as_f64().map(|ns| ns / 1e3);
        let medians: Vec<f64> = rounds.iter().map(|reports| median(reports.iter().filter_map(us))).collect();
        let range = medians.iter().fold([f64::INFINITY, 0.0], |[low, high], m| [m.min(low), m.max(high)]);
        result[format!("{key}_us")] = json!(median(rounds.iter().flatten().filter_map(us)));
        result[format!("{key}_us_rounds")] = json!(range);
    }
    result
}
