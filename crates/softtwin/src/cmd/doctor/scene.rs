//! Checks of a scene: its models and its sensors.

use super::finding::Finding;
use runtime::config::Scene;
use runtime::load::load_scene;
use runtime::source::SensorCounters;
use runtime::source::{Devices, Source, SourceReader};
use runtime::wire::SensorSample;
use runtime::wire::layout::value_bits;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How long a sensor may take to answer once, its own time-outs and first attempts to reconnect included.
const SENSOR_TIMEOUT: Duration = Duration::from_secs(3);

/// The scene file, all its models, all its sources.
pub fn scene(path: &Path) -> Vec<Finding> {
    let scene = match Scene::load(path) {
        Ok(scene) => scene,
        Err(error) => return vec![Finding::bad("scene", error, "correct the file")],
    };
    let mut findings = vec![models(&scene, path)];
    let (devices, mut opened_all) = (Devices::default(), Vec::new());
    for actuator in &scene.actuators {
        if let Some(opened) = actuator.open_source(&scene.folder, &devices) {
            opened_all.push((format!("source of `{}`", actuator.name), opened));
        }
    }
    // All are opened before the first starts: sensors of several actuators may share a device path.
    findings.extend(opened_all.into_iter().map(|(subject, opened)| source(&subject, opened)));
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

/// The first reading in which no value is missing; the last one if none comes in time.
fn complete(source: &mut SourceReader) -> Option<SensorSample> {
    let (end, mut last) = (Instant::now() + SENSOR_TIMEOUT, None);
    while let Some(reading) = source.next(end.saturating_duration_since(Instant::now())) {
        last = Some(reading);
        if reading.stale_values == 0 || Instant::now() >= end {
            break;
        }
    }
    last
}

/// The values that a reading has: `0.03 MPa, gap 40 mm, load_n 2.6`.
fn values(reading: &SensorSample) -> String {
    let own = [
        (format!("{} MPa", reading.pressure_mpa), reading.pressure_mpa),
        (format!("gap {} mm", reading.gap_mm), reading.gap_mm),
        (format!("force {} N", reading.measured_force_n), reading.measured_force_n),
    ];
    let own = own.into_iter().filter(|(_, value)| !value.is_nan()).map(|(text, _)| text);
    let named = reading.inputs().map(|(name, value)| format!("{name} {value}"));
    own.chain(named).collect::<Vec<_>>().join(", ")
}

/// Takes one reading.
fn source(subject: &str, opened: Result<Box<dyn Source>, Vec<String>>) -> Finding {
    let mut source = match opened.map(SourceReader::start) {
        Ok(Ok(source)) => source,
        Ok(Err(error)) => {
            return Finding::bad(subject, error, "the system has no thread left: raise TasksMax");
        }
        Err(diagnostics) => {
            return Finding::bad(subject, diagnostics.join("; "), "correct the scene or the trace");
        }
    };
    let reading = complete(&mut source);
    let devices = source.devices();
    if devices.is_empty() {
        return match reading {
            Some(reading) => Finding::good(subject, format!("first reading {}", values(&reading))),
            None => Finding::bad(subject, "it has no readings", "choose another part of the trace"),
        };
    }
    let summary = || {
        let of_device =
            |(name, device): &(String, Arc<SensorCounters>)| format!("{name} {}", device.summary());
        devices.iter().map(of_device).collect::<Vec<_>>().join("; ")
    };
    let absent = |bits: u32| value_bits::names(bits).collect::<Vec<_>>().join(", ");
    match reading {
        Some(reading) if reading.stale_values != 0 => Finding::bad(
            subject,
            format!("no answer with {} ({})", absent(reading.stale_values), summary()),
            "timeouts: wiring, unit_id, baud; refusals: address, port, rights; garbage: parity, baud, `from` of its values",
        ),
        Some(reading) if reading.status == 0 => {
            Finding::good(subject, format!("it answers: {}", values(&reading)))
        }
        Some(reading) => Finding::bad(
            subject,
            format!("it answers with fault {}", reading.status),
            "Modbus: 2 wrong register, 4 the device itself is faulty; see its manual",
        ),
        None => {
            let found = format!("no reading within {} s ({})", SENSOR_TIMEOUT.as_secs(), summary());
            let remedy = "timeouts: wiring, unit_id, baud; refusals: address, port, rights (group dialout), a bridge that holds \
                          the port; garbage: parity, baud, encoding";
            Finding::bad(subject, found, remedy)
        }
    }
}
