//! Prediction along a trace of inputs.

use crate::files::save;
use crate::motion::{Followed, Trace, follow_measured, follow_shape};
use crate::report;
use anyhow::Result;
use formats::table::to_text;
use formats::trace::SERIES_COLUMNS;
use rom::branch::VOLUME;
use rom::model::Model;
use serde_json::json;
use std::path::Path;

/// Predicts along a trace, writes the series and reports.
pub fn run(model: &Model, trace: &Path, out: &Path, step_ms: f64, as_json: bool) -> Result<()> {
    let trace = Trace::read(trace, model)?;
    let step_ns = (1e6 * step_ms) as u64;
    if model.is_measured() {
        let (columns, followed) = follow_measured(model, &trace, step_ns)?;
        let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
        return write(&trace, &columns, &followed, out, as_json);
    }
    let followed = follow_shape(model, &trace, step_ns)?;
    let has_volume = !followed.volumes_mm3.is_empty();
    let columns: Vec<&str> = SERIES_COLUMNS.into_iter().chain(has_volume.then_some(VOLUME)).collect();
    write(&trace, &columns, &followed, out, as_json)
}

fn write<Row: AsRef<[f64]>>(
    trace: &Trace,
    columns: &[&str],
    followed: &Followed<Row>,
    out: &Path,
    as_json: bool,
) -> Result<()> {
    let cell = |value: &f64| if value.is_finite() { value.to_string() } else { String::new() };
    let row = |(at, row): (usize, &Row)| {
        let volume_mm3 = followed.volumes_mm3.get(at).filter(|_| columns.contains(&VOLUME));
        row.as_ref().iter().chain(volume_mm3).map(cell).collect::<Vec<_>>()
    };
    let rows = followed.rows.iter().enumerate().map(row);
    save(out, to_text(columns, rows).as_bytes())?;
    if let Some(first) = &followed.first_outside {
        tracing::warn!(
            "{} of {} instants are outside the training range and have no half-widths; the first at {first}",
            followed.outside,
            followed.rows.len()
        );
    }
    let report = json!({
        "rows": followed.rows.len(),
        "seconds": trace.length_s(),
        "moves": followed.moves,
        "outside_training_range": followed.outside,
        "load_outside_range": followed.load_outside,
        "restarts": followed.restarts,
        "limits_passed": followed.snaps,
        "state_us_per_ms": 1e3 * followed.state_s / trace.length_s(),
    });
    report::print(&report, as_json)
}
