//! Time of one control cycle, of the computation alone.

use super::compare::{Bench, cases, known};
use crate::plant::report::{Percentiles, percentiles};
use control::inverse::Quantity;
use control::law::{Controller, Reading, Target};
use control::settings::{LawKind, Limits, Settings};
use control::twin_model::{Tip, TwinModel};
use rom::rng::Rng;
use serde_json::{Value, json};
use std::time::Instant;

/// Turns that are measured.
const TURNS: usize = 5_000;
/// Time between control cycles, s.
const CYCLE_S: f64 = 5e-3;
/// Turns of one target.
const A_TARGET: usize = 250;
/// Standard deviations of the readings' noise: pressure, MPa, gap, mm, force, N.
const NOISE: [f64; 3] = [5e-5, 0.05, 2e-3];

/// Force with a measured value, force without, tip without.
pub fn measure(bench: &Bench) -> anyhow::Result<Value> {
    let mut all = serde_json::Map::new();
    for (name, law, quantity, is_measured) in [
        ("force, load cell", LawKind::Inverse, Quantity::Force, true),
        ("force, no load cell", LawKind::Inverse, Quantity::Force, false),
        ("tip, no camera", LawKind::Inverse, Quantity::Observable, false),
        ("predictive: force, load cell", LawKind::Predictive, Quantity::Force, true),
        ("predictive: tip, no camera", LawKind::Predictive, Quantity::Observable, false),
    ] {
        all.insert(name.into(), json!(turns(bench, law, quantity, is_measured)?));
    }
    Ok(Value::Object(all))
}

fn turns(bench: &Bench, law: LawKind, quantity: Quantity, is_measured: bool) -> anyhow::Result<Percentiles> {
    let model = TwinModel::new(&bench.model, Tip::REFERENCE)?;
    let settings = cases().first().map(|case| known(&case.spec)).unwrap_or_default();
    let settings = Settings { law, ..settings };
    let mut controller = Controller::new(model, quantity, settings, Limits::default());
    let (mut pressure_mpa, mut durations_ns) = (0.02, Vec::with_capacity(TURNS));
    let mut random = Rng::new(TURNS as u64);
    for turn in 0..TURNS {
        let high = (turn / A_TARGET).is_multiple_of(2);
        let (target, gap_mm) = match quantity {
            Quantity::Force => (if high { 0.4 } else { 0.1 }, 35.0),
            _ => (if high { -30.0 } else { -45.0 }, 70.0),
        };
        let measured = if is_measured { (pressure_mpa - 0.008) * 10.0 } else { f64::NAN };
        let [pressure_mpa_off, gap_mm_off, force_n_off] = NOISE.map(|sigma| sigma * random.normal());
        let reading = Reading {
            pressure_mpa: pressure_mpa + pressure_mpa_off,
            gap_mm: gap_mm + gap_mm_off,
            measured: measured + force_n_off,
            written_mpa: f64::NAN,
        };
        let begin = Instant::now();
        let found = controller.update(&|_| Target::step(target), reading, CYCLE_S);
        durations_ns.push(begin.elapsed().as_nanos() as u64);
        if found.fault.is_some() {
            controller.release(); // the plant is not the model's: only the time counts
            continue;
        }
        pressure_mpa += (found.pressure_mpa - pressure_mpa) * (CYCLE_S / 0.08); // a lag of 80 ms
    }
    Ok(percentiles(&mut durations_ns))
}

/// As lines for people.
pub fn text(times: &Value) -> String {
    let mut out = format!(
        "one control cycle (this build, this machine), readings with noise of {} Pa, {} mm, {} mN\n",
        1e6 * NOISE[0],
        NOISE[1],
        1e3 * NOISE[2]
    );
    for (name, found) in times.as_object().into_iter().flatten() {
        let number = |key: &str| found[key].as_f64().unwrap_or(f64::NAN);
        out += &format!(
            "  {name}: median {:.1} us, 99 of 100 {:.1} us, slowest {:.1} us of {TURNS}\n",
            number("p50_us"),
            number("p99_us"),
            number("max_us")
        );
    }
    out
}
