//! A recording as CSV tables, one for each topic.

use crate::failure::{configuration, usage};
use crate::report;
use anyhow::{Context, Result};
use recording::{ExportError, Series, TableForm, export_csv};
use serde_json::json;
use std::path::Path;
use wire::KeyExpr;

/// Writes the tables of the topics that match `key` into `folder` and says what they hold.
///
/// # Errors
/// A file that is no recording, a folder that cannot be written.
pub fn write(recording: &Path, folder: &Path, key: &str, form: TableForm, json: bool) -> Result<()> {
    let topics = KeyExpr::new(key).map_err(usage)?;
    let series = Series::open(recording)
        .with_context(|| format!("cannot read the recording ({})", recording.display()))
        .map_err(configuration)?;
    let mut reader = series.reader();
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let exported = export_csv(&mut reader, folder, &topics, form).map_err(|error| match error {
        error @ ExportError::Read(_) => configuration(error),
        error => error.into(),
    })?;
    let ending = reader.ending();
    let rows: serde_json::Map<String, serde_json::Value> =
        exported.rows.iter().map(|(path, rows)| (path.display().to_string(), json!(rows))).collect();
    report::print(&json!({"rows": rows, "left_out": exported.left_out, "ending": ending}), json)
}
