//! How long a restart takes, measured with real processes.

use crate::stats::median;
use crate::testbed::{Sine, Testbed};
use crate::verify::Verifier;
use anyhow::Context;
use serde_json::json;
use softtwin::failure::configuration;
use softtwin::{output, resources};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use wire::layout::flags;
use wire::{FieldReader, State, StateReader, Topic, WakeSet, Wakeable, now_ns};

/// Measure how long the shipped scene's twin takes to start, and a killed twin and bridge until data flow again.
///
/// Start: from the new process of the scene's twin to its line `ready`, without load and with all cores loaded; its
/// resident memory; from the first reading's stamp to the first field at a reader.
/// Restart:
/// A twin and a bridge at 1 kHz are killed and restarted. The twin: from the start of the new process to its first fresh
/// field at a reader, with the model on disk. The bridge: from the kill to the twin's first stale state, and from
/// the start of the new process to the state of its first reading.
#[derive(clap::Args)]
pub struct Args {
    /// Model file.
    #[arg(long, value_name = "FILE.twin", default_value = "models/pneunet/pneunet.twin")]
    model: PathBuf,
    /// Scene whose twin is started.
    #[arg(long, value_name = "FILE.toml", default_value = "config/scenes/finger.toml")]
    scene: PathBuf,
    /// Starts and restarts of each.
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u16).range(1..=10_000))]
    rounds: u16,
}

/// How long anything may take.
const PATIENCE: Duration = Duration::from_secs(60);

impl Args {
    /// Measures and prints.
    pub fn run(self) -> anyhow::Result<()> {
        let bytes = std::fs::read(&self.model)
            .with_context(|| format!("cannot read {}", self.model.display()))
            .map_err(configuration)?;
        let mut verifier = Verifier::new(&bytes).map_err(configuration)?;
        let start = self.starts()?;
        let testbed = Testbed::new("restart")?;
        testbed.write("finger.twin", &bytes)?;
        let readings = Sine::through_the_onset(1000.0, 40.0);
        let scene = readings.scene("finger", "finger.twin".as_ref(), "", &["nodes = \"all\"".into()]);
        let scene = testbed.write("scene.toml", scene)?;
        let mut twin = testbed.daemon("twin", &scene, &[])?;
        let mut bridge = testbed.daemon("bridge", &scene, &[])?;
        let bus = testbed.bus()?;
        let fields = FieldReader::open(&bus, &Topic::field("finger", None)?)?;
        let states = StateReader::open(&bus, &Topic::state("finger")?)?;
        let (mut twin_ms, mut stale_ms, mut bridge_ms) = (Vec::new(), Vec::new(), Vec::new());
        for _ in 0..self.rounds {
            let run = wait_state(&states, |state| fresh(state.flags))?.boot_id;
            twin.kill()?;
            let started = Instant::now();
            twin = testbed.start_daemon("twin", &scene, &[])?;
            wait_for(&fields, || {
                while let Some(sample) = fields.next()? {
                    verifier.field(&sample);
                    if sample.header().boot_id != run && fresh(sample.header().flags) {
                        return Ok(Some(()));
                    }
                }
                Ok(None)
            })?;
            twin_ms.push(ms_since(started));

            let before = wait_state(&states, |state| fresh(state.flags))?;
            let killed = Instant::now();
            bridge.kill()?;
            wait_state(&states, |state| state.flags & flags::STALE != 0)?;
            stale_ms.push(ms_since(killed));
            let started = Instant::now();
            bridge = testbed.start_daemon("bridge", &scene, &[])?;
            wait_state(&states, |s| fresh(s.flags) && s.sensor_boot_id != before.sensor_boot_id)?;
            bridge_ms.push(ms_since(started));
        }
        bridge.stop()?;
        twin.stop()?;
        output::json(&json!({
            "rounds": self.rounds,
            "start": start,
            "twin_start_to_fresh_field_ms": median_and_worst(&twin_ms),
            "bridge_kill_to_stale_ms": median_and_worst(&stale_ms),
            "bridge_start_to_fresh_state_ms": median_and_worst(&bridge_ms),
            "verified": verifier.counts,
        }))
    }
}

impl Args {
    /// Starts of the scene's twin.
    fn starts(&self) -> anyhow::Result<serde_json::Value> {
        let scene = self.scene.canonicalize().with_context(|| self.scene.display().to_string())?;
        let (mut ready_ms, mut busy_ms, mut field_ms) = (Vec::new(), Vec::new(), Vec::new());
        let mut resident_mb = Vec::new();
        for _ in 0..self.rounds {
            let testbed = Testbed::new("start")?;
            let started = Instant::now();
            let mut twin = testbed.daemon("twin", &scene, &[])?;
            ready_ms.push(ms_since(started));
            let resident_kb = resources::status(&twin.id().to_string(), "VmRSS").context("no VmRSS")?;
            resident_mb.push(resident_kb as f64 / 1e3);
            let fields = FieldReader::open(&testbed.bus()?, &Topic::field("finger", None)?)?;
            let mut bridge = testbed.start_daemon("bridge", &scene, &[])?;
            field_ms.push(wait_for(&fields, || {
                let stamp = fields.next()?.map(|sample| sample.header().t_sensor_ns);
                Ok(stamp.map(|stamp| now_ns().saturating_sub(stamp) as f64 / 1e6))
            })?);
            bridge.stop()?;
            twin.stop()?;
        }
        let busy = AtomicBool::new(true);
        std::thread::scope(|scope| {
            for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
                scope.spawn(|| {
                    while busy.load(Ordering::Relaxed) {
                        std::hint::spin_loop()
                    }
                });
            }
            let measured = (0..self.rounds).try_for_each(|_| {
                let testbed = Testbed::new("start")?;
                let started = Instant::now();
                let mut twin = testbed.daemon("twin", &scene, &[])?;
                busy_ms.push(ms_since(started));
                twin.stop()
            });
            busy.store(false, Ordering::Relaxed);
            measured
        })?;
        Ok(json!({
            "ready_ms": median_and_worst(&ready_ms),
            "ready_with_all_cores_loaded_ms": median_and_worst(&busy_ms),
            "resident_mb": median_and_worst(&resident_mb),
            "first_reading_to_field_ms": median_and_worst(&field_ms),
        }))
    }
}

fn fresh(sample_flags: u32) -> bool {
    sample_flags & (flags::STALE | flags::HELD | flags::NO_DATA) == 0
}

fn wait_for<T>(
    reader: &dyn Wakeable,
    mut next: impl FnMut() -> anyhow::Result<Option<T>>,
) -> anyhow::Result<T> {
    let mut wake = WakeSet::new([reader]);
    let end = Instant::now() + PATIENCE;
    while Instant::now() < end {
        if let Some(found) = next()? {
            return Ok(found);
        }
        wake.wait(Duration::from_millis(200))?;
    }
    anyhow::bail!("the expected sample did not come within {PATIENCE:?}")
}

fn wait_state(states: &StateReader, wanted: impl Fn(&State) -> bool) -> anyhow::Result<State> {
    wait_for(states, || {
        while let Some(state) = states.next()? {
            if wanted(&state) {
                return Ok(Some(state));
            }
        }
        Ok(None)
    })
}

fn ms_since(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}

fn median_and_worst(values: &[f64]) -> serde_json::Value {
    let worst = values.iter().copied().fold(f64::NAN, f64::max);
    json!({ "median": median(values.iter().copied()), "worst": worst })
}
