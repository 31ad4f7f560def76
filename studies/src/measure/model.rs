//! Whole fields from a model in this process: Rust, and Python through its native module, in turn.

use super::clients::PYTHON;
use super::twin::{model, print};
use crate::testbed::output_of;
use anyhow::Context;
use rom::inputs::Inputs;
use rom::model::{Model, Selection};
use rom::model_state::ModelState;
use serde_json::{Value, json};
use std::process::Command;
use std::time::Instant;

/// States of one round, as in predict_time.py.
const STATES: u32 = 500;

/// Time of a whole field without a daemon, in Rust and in Python.
#[derive(clap::Args)]
pub struct Args {
    /// Rounds, Rust and Python in turn; the smallest of their medians count.
    #[arg(long, default_value_t = 7)]
    rounds: u32,
    /// Ends with 1 when Python takes more than this many times Rust's time; with at most 15 rounds, as many as it takes.
    #[arg(long, value_name = "RATIO")]
    at_most: Option<f64>,
    /// The same when it takes less: one that is too small says that Rust was disturbed.
    #[arg(long, value_name = "RATIO")]
    at_least: Option<f64>,
}

/// Rounds after which a ratio that is still too large or too small is believed: other programs disturb single rounds.
const MAX_ROUNDS: u32 = 15;

/// Smallest medians so far (us).
struct Times {
    rust: f64,
    python: f64,
    python_new_memory: f64,
}

impl Args {
    /// Measures and prints.
    pub fn run(self) -> anyhow::Result<()> {
        let path = model()?;
        let model = Model::read(&path)?.0;
        let mut state = ModelState::new(&model, &Selection::default())?;
        let mut python = Command::new(PYTHON);
        python.env("PYTHONPATH", "clients/python/src");
        python
            .arg("clients/python/examples/predict_time.py")
            .arg(&path)
            .args(["--states", &STATES.to_string()]);
        let never = f64::INFINITY;
        let mut times = Times { rust: never, python: never, python_new_memory: never };
        let (least, most) = (self.at_least.unwrap_or(0.0), self.at_most.unwrap_or(f64::INFINITY));
        let within = |times: &Times| (least..=most).contains(&(times.python / times.rust));
        let mut rounds = 0;
        while rounds < self.rounds || (rounds < MAX_ROUNDS && !within(&times)) {
            times.rust = times.rust.min(rust_us(&mut state)?);
            let printed: Value = serde_json::from_str(output_of(&mut python)?.trim())?;
            let time =
                |key: &str| printed[key].as_f64().with_context(|| format!("expected {key} in {printed}"));
            times.python = times.python.min(time("out_us")?);
            times.python_new_memory = times.python_new_memory.min(time("new_memory_us")?);
            rounds += 1;
        }
        let ratio = times.python / times.rust;
        print(
            "whole field",
            json!({
                "rust_us": times.rust, "python_us": times.python, "python_new_memory_us": times.python_new_memory,
                "ratio": ratio, "rounds": rounds,
            }),
        )?;
        anyhow::ensure!(
            within(&times),
            "Python takes {ratio:.2} times the time of Rust, {least} to {most} expected"
        );
        Ok(())
    }
}

/// Median of one round (us).
fn rust_us(state: &mut ModelState) -> anyhow::Result<f64> {
    let mut times = (0..STATES)
        .map(|at| {
            let pressure_mpa = 0.02 + 0.06 * f64::from(at) / f64::from(STATES - 1);
            let began = Instant::now();
            state.update(Inputs::new(pressure_mpa, 30.0))?;
            Ok(began.elapsed().as_secs_f64() * 1e6)
        })
        .collect::<anyhow::Result<Vec<f64>>>()?;
    times.sort_by(f64::total_cmp);
    Ok(times[times.len() / 2])
}
