//! Whole fields from a model in this process: Rust, and Python through libsofttwin, in turn.

use super::clients::PYTHON;
use super::twin::{model, print};
use anyhow::Context;
use rom::inputs::Inputs;
use rom::model::{Model, Selection};
use rom::model_state::ModelState;
use serde_json::{Value, json};
use softtwin::daemon::program;
use softtwin::testbed::output_of;
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
}

impl Args {
    /// Measures and prints.
    pub fn run(self) -> anyhow::Result<()> {
        let path = model()?;
        let model = Model::from_bytes(&std::fs::read(&path)?)?;
        let mut state = ModelState::new(&model, &Selection::default())?;
        let library = program("softtwind")?.with_file_name("libcapi.so");
        let mut python = Command::new(PYTHON);
        python.env("PYTHONPATH", "clients/python/src").env("SOFTTWIN_LIBRARY", library);
        python
            .arg("clients/python/examples/predict_time.py")
            .arg(&path)
            .args(["--states", &STATES.to_string()]);
        let [mut rust_us, mut out_us, mut new_us] = [f64::INFINITY; 3];
        for _ in 0..self.rounds {
            let mut times = (0..STATES)
                .map(|at| {
                    let pressure_mpa = 0.02 + 0.06 * f64::from(at) / f64::from(STATES - 1);
                    let began = Instant::now();
                    state.update(Inputs::new(pressure_mpa, 30.0))?;
                    Ok(began.elapsed().as_secs_f64() * 1e6)
                })
                .collect::<anyhow::Result<Vec<f64>>>()?;
            times.sort_by(f64::total_cmp);
            rust_us = rust_us.min(times[times.len() / 2]);
            let said: Value = serde_json::from_str(output_of(&mut python)?.trim())?;
            let time = |key: &str| said[key].as_f64().with_context(|| format!("expected {key} in {said}"));
            (out_us, new_us) = (out_us.min(time("out_us")?), new_us.min(time("new_memory_us")?));
        }
        print(
            "whole field",
            json!({ "rust_us": rust_us, "python_us": out_us, "python_new_memory_us": new_us, "ratio": out_us / rust_us }),
        )
    }
}
