//! Prediction along a trace of inputs.

use crate::files::save;
use crate::motion::{Trace, follow};
use crate::output;
use anyhow::Result;
use fem::transient::SERIES_COLUMNS;
use formats::table::to_text;
use rom::model::Model;
use serde_json::json;
use std::path::Path;

/// Predicts along a trace, writes the series and reports.
pub fn run(model: &Model, trace: &Path, out: &Path, step_ms: f64) -> Result<()> {
    let trace = Trace::read(trace, model)?;
    let followed = follow(model, &trace, (1e6 * step_ms) as u64)?;
    let cell = |value: &f64| if value.is_finite() { value.to_string() } else { String::new() };
    let rows = followed.rows.iter().map(|row| row.iter().map(cell).collect::<Vec<_>>());
    save(out, to_text(&SERIES_COLUMNS, rows).as_bytes())?;
    output::json(&json!({
        "rows": followed.rows.len(),
        "seconds": trace.length_s(),
        "moves": followed.moves,
        "outside_training_range": followed.outside,
        "load_outside_range": followed.load_outside,
        "restarts": followed.restarts,
        "state_us_per_ms": 1e3 * followed.state_s / trace.length_s(),
    }))
}
