//! Checks of a scene: its models and its sensors.

use super::finding::Finding;
use runtime::config::Scene;
use runtime::source::live::{LiveSource, LiveSpec};
use runtime::source::{Source, SourceSpec};
use runtime::twin::load_scene;
use std::path::Path;
use std::sync::mpsc::sync_channel;
use std::time::Duration;

/// How long a sensor may take to answer once, its own time-outs and first attempts to reconnect included.
const SENSOR_TIMEOUT: Duration = Duration::from_secs(3);

/// The scene file, all its models, all its sources.
pub fn scene(path: &Path) -> Vec<Finding> {
    let scene = match Scene::load(path) {
        Ok(scene) => scene,
        Err(error) => return vec![Finding::bad("scene", error, "correct the file")],
    };
    let mut findings = vec![models(&scene, path)];
    for actuator in &scene.actuators {
        if let Some(spec) = &actuator.source {
            findings.push(source(&format!("source of `{}`", actuator.name), spec, &scene.folder));
        }
    }
    findings
}

fn models(scene: &Scene, path: &Path) -> Finding {
    let subject = "scene and models";
    match load_scene(scene, path) {
        Ok(loaded) => {
            let names: Vec<&str> = loaded.iter().map(|loaded| loaded.spec.name.as_str()).collect();
            Finding::good(subject, format!("{} loaded", names.join(", ")))
        }
        Err(error) => {
            Finding::bad(subject, error, "`softtwin inspect` the model; train it again if it is damaged")
        }
    }
}

fn source(subject: &str, spec: &SourceSpec, folder: &Path) -> Finding {
    match spec.open(folder) {
        Err(diagnostics) => Finding::bad(subject, diagnostics.join("; "), "correct the scene or the trace"),
        Ok(Source::Live(spec)) => sensor(subject, spec),
        Ok(mut source) => match source.next_reading() {
            Some(reading) => Finding::good(subject, format!("first reading {} MPa", reading.pressure_mpa)),
            None => Finding::bad(subject, "it has no readings", "choose another part of the trace"),
        },
    }
}

/// Reads the sensor once.
fn sensor(subject: &str, spec: LiveSpec) -> Finding {
    let (sender, receiver) = sync_channel(1);
    let started = match LiveSource::start(spec, 0, sender) {
        Ok(started) => started,
        Err(error) => {
            return Finding::bad(subject, error, "the system has no thread left: raise TasksMax");
        }
    };
    match receiver.recv_timeout(SENSOR_TIMEOUT) {
        Ok(reading) if reading.status == 0 => Finding::good(
            subject,
            format!(
                "it answers: {} MPa, gap {} mm, force {} N",
                reading.pressure_mpa, reading.gap_mm, reading.measured_force_n
            ),
        ),
        Ok(reading) => Finding::bad(
            subject,
            format!("it answers with fault {}", reading.status),
            "Modbus: 2 wrong register, 4 the device itself is faulty; see its manual",
        ),
        Err(_) => {
            let counts = started.counters().all();
            let counted: Vec<String> = counts
                .iter()
                .filter(|(_, count)| *count > 0)
                .map(|(name, count)| format!("{count} {name}"))
                .collect();
            let found = format!("no reading within {} s ({})", SENSOR_TIMEOUT.as_secs(), counted.join(", "));
            let remedy = "timeouts: wiring, unit_id, baud; refusals: address, port, rights (group dialout), a bridge that holds \
                          the port; garbage: parity, baud, encoding";
            Finding::bad(subject, found, remedy)
        }
    }
}
