//! `softtwin inspect TABLE`: the columns of a bench's table, and a proposed mapping.

use crate::picture::{Figure, Panel, Series};
use crate::{files, output, report};
use formats::log::{Log, TableDescription, describe};
use formats::table::TableForm;
use std::path::Path;

/// Describes a table and proposes a mapping of its columns.
pub fn run(file: &Path, out: Option<&Path>, picture: Option<&Path>, json: bool) -> anyhow::Result<()> {
    let log = Log::read(file, &TableForm::default()).map_err(files::refusal)?;
    let found = describe(&log, &file.display().to_string());
    if let Some(out) = out {
        files::save(out, found.mapping.as_bytes())?;
    }
    if let Some(picture) = picture {
        figure(&log, &found).save(picture)?;
    }
    report::print(&found, json)?;
    match out {
        _ if json => {}
        Some(out) => output!("mapping to complete: {}", out.display())?,
        None => output!("\n{}", found.mapping.trim_end())?,
    }
    Ok(())
}

fn figure(log: &Log, found: &TableDescription) -> Figure {
    let rows: Vec<f64> = (0..log.rows()).map(|row| row as f64).collect();
    let x = found.time_column.map_or(&rows, |number| &log.columns[number - 1]);
    let first = x.first().copied().unwrap_or(0.0);
    let label = if found.time_column.is_some() { "time, in the column's unit" } else { "row" };
    let others = found.columns.iter().filter(|column| Some(column.column) != found.time_column);
    let panels = others.map(|column| {
        let points = x.iter().zip(&log.columns[column.column - 1]).map(|(x, y)| (x - first, *y));
        let y = match &column.unit {
            _ if column.constant => "constant",
            unit => unit.as_deref().unwrap_or("unit not known"),
        };
        let title = format!("{} {}", column.column, column.heading);
        Panel::new(title, label, y, vec![Series::line("", 0, points)])
    });
    Figure { title: "columns against time".into(), panels: panels.collect(), columns: 3 }
}
