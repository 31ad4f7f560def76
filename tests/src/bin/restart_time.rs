//! How long a restart takes, measured with real processes: `restart_time MODEL [ROUNDS]` prints one JSON object.
//!
//! A twin and a bridge at 1 kHz of the model are killed with signal 9 and started anew. For the twin: from the start of the new
//! process to its first fresh field in a reader's hand, with the model on disk. For the bridge: from the kill to the twin's first
//! stale state, and from the start of the new process to its first reading's state.

use std::time::Instant;
use tests::judge::Judge;
use tests::wait::{fresh, states, wait_for, wait_state};
use tests::{Program, Stage};
use wire::layout::flags;
use wire::{FieldReader, Topic};

const SOURCE: &str = r#"kind = "simulate"
rate_hz = 1000.0
gap_mm = 40.0
profile = { shape = "sine", mean_mpa = 0.035, amplitude_mpa = 0.03, frequency_hz = 0.5 }"#;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (model, rounds) = match arguments.as_slice() {
        [model] => (model, 20),
        [model, rounds] => (model, rounds.parse()?),
        _ => return Err("usage: restart_time MODEL [ROUNDS]".into()),
    };
    let bytes = std::fs::read(model)?;
    let mut judge = Judge::new(&bytes);
    let stage = Stage::with_model("restart", &bytes);
    let scene = stage.whole_finger(SOURCE);
    let scene_text = scene.display().to_string();
    let mut twin = Program::twin(&stage, &scene);
    let mut bridge = Program::bridge(&stage, &scene);
    let bus = stage.bus();
    let fields = FieldReader::open(&bus, &Topic::field("finger", None)?)?;
    let states = states(&bus);
    let (mut twin_ms, mut stale_ms, mut bridge_ms) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..rounds {
        let run = wait_state(&states, "a fresh state", fresh).boot_id;
        twin.kill();
        let started = Instant::now();
        twin = Program::daemon(&stage, &["twin", "--scene", &scene_text]);
        wait_for(&fields, "a field of the new twin", |fields| {
            while let Some(sample) = fields.next().expect("readable") {
                judge.field(&sample);
                let header = sample.header();
                if header.boot_id != run && header.flags & (flags::STALE | flags::HELD | flags::NO_DATA) == 0
                {
                    return Some(());
                }
            }
            None
        });
        twin_ms.push(started.elapsed().as_secs_f64() * 1e3);

        let before = wait_state(&states, "a fresh state", fresh);
        let killed = Instant::now();
        bridge.kill();
        wait_state(&states, "a stale state", |state| state.flags & flags::STALE != 0);
        stale_ms.push(killed.elapsed().as_secs_f64() * 1e3);
        let started = Instant::now();
        bridge = Program::daemon(&stage, &["bridge", "--scene", &scene_text]);
        wait_state(&states, "a state of the new bridge", |state| {
            fresh(state) && state.sensor_boot_id != before.sensor_boot_id
        });
        bridge_ms.push(started.elapsed().as_secs_f64() * 1e3);
    }
    println!(
        "{}",
        serde_json::json!({
            "rounds": rounds,
            "twin_start_to_fresh_field_ms": median_and_worst(twin_ms),
            "bridge_kill_to_stale_ms": median_and_worst(stale_ms),
            "bridge_start_to_fresh_state_ms": median_and_worst(bridge_ms),
            "judge": judge.report(),
        })
    );
    Ok(())
}

fn median_and_worst(mut values: Vec<f64>) -> serde_json::Value {
    values.sort_by(f64::total_cmp);
    let round = |value: Option<&f64>| value.map(|value| (value * 10.0).round() / 10.0);
    serde_json::json!({"median": round(values.get(values.len() / 2)), "worst": round(values.last())})
}
