//! Checks of a scene: its models and its sensors.

use super::finding::Finding;
use runtime::config::Scene;
use runtime::load::load_scene;
use runtime::source::{SourceReader, SourceSpec};
use std::path::Path;
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

/// Takes one reading.
fn source(subject: &str, spec: &SourceSpec, folder: &Path) -> Finding {
    let mut source = match spec.open(folder).map(SourceReader::start) {
        Ok(Ok(source)) => source,
        Ok(Err(error)) => {
            return Finding::bad(subject, error, "the system has no thread left: raise TasksMax");
        }
        Err(diagnostics) => {
            return Finding::bad(subject, diagnostics.join("; "), "correct the scene or the trace");
        }
    };
    let reading = source.next(SENSOR_TIMEOUT);
    let Some(device) = source.device() else {
        return match reading {
            Some(reading) => Finding::good(subject, format!("first reading {} MPa", reading.pressure_mpa)),
            None => Finding::bad(subject, "it has no readings", "choose another part of the trace"),
        };
    };
    match reading {
        Some(reading) if reading.status == 0 => Finding::good(
            subject,
            format!(
                "it answers: {} MPa, gap {} mm, force {} N",
                reading.pressure_mpa, reading.gap_mm, reading.measured_force_n
            ),
        ),
        Some(reading) => Finding::bad(
            subject,
            format!("it answers with fault {}", reading.status),
            "Modbus: 2 wrong register, 4 the device itself is faulty; see its manual",
        ),
        None => {
            let found = format!("no reading within {} s ({})", SENSOR_TIMEOUT.as_secs(), device.summary());
            let remedy = "timeouts: wiring, unit_id, baud; refusals: address, port, rights (group dialout), a bridge that holds \
                          the port; garbage: parity, baud, encoding";
            Finding::bad(subject, found, remedy)
        }
    }
}
