//! A model along motions of the finite elements: errors of the series, and those of the same model without inertia.

use super::curves;
use super::motion::{Motion, frequency_hz};
use crate::files::refusal;
use crate::motion::{Followed, Trace, follow_shape};
use crate::output;
use anyhow::Result;
use formats::table::Table;
use formats::trace::{SERIES, SERIES_COLUMNS};
use formats::{Diagnostic, FormatError};
use rom::model::{BlockKind, Model};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Width of the mean of the contact force, s.
const FORCE_WINDOW_S: f64 = 0.01;
/// Place of the contact force in a series.
const FORCE: usize = 6;
/// Place of the stress in a series.
const STRESS: usize = 7;
/// Places of the tip's coordinates in a series.
const TIP: [usize; 3] = [4, 5, 8];
/// First quantity of a series that is predicted.
const FIRST: usize = 3;

/// Errors along one motion, root mean square in % of the range of each quantity; of positions, in % of the length of the tip's range, because
/// an obstacle holds single coordinates.
#[derive(Debug, Serialize)]
struct Errors {
    series: PathBuf,
    /// `free`, `contact` (throughout) or `landing`.
    class: &'static str,
    inertia: [Option<f64>; SERIES - FIRST],
    statics: [Option<f64>; SERIES - FIRST],
    /// Values within the half-widths of the motion, %.
    coverage: [Option<f64>; SERIES - FIRST],
    outside_training_range: usize,
    /// Frequencies of the swing after the last change of pressure, finite elements and model.
    frequency_hz: Option<[f64; 2]>,
}

/// Compares, draws and prints.
pub fn run(model: &Model, folders: &[PathBuf], picture: Option<&Path>, as_json: bool) -> Result<()> {
    let mut without = model.clone();
    without.blocks.retain(|(kind, _)| !matches!(kind, BlockKind::Inertia | BlockKind::Memory));
    let compare = |folder: &PathBuf| -> Result<(Errors, Motion)> {
        let series = folder.join("series.csv");
        let truth = read(&series)?;
        let trace = Trace::read(&series, model)?;
        let followed = follow_shape(model, &trace, u64::MAX)?;
        let still = follow_shape(&without, &trace, u64::MAX)?;
        let touching = truth.iter().filter(|row| row[FORCE] > 0.0).count();
        let class = match touching {
            0 => "free",
            all if all == truth.len() => "contact",
            _ => "landing",
        };
        let outside_training_range = followed.outside;
        let (inertia, statics) = (errors(&truth, &followed.rows), errors(&truth, &still.rows));
        let coverage = coverage(&truth, &followed);
        let both = frequency_hz(&truth).zip(frequency_hz(&followed.rows));
        let frequency_hz = both.filter(|_| class != "landing").map(|(truth, model)| [truth, model]);
        let name = folder.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        let motion = Motion { name, truth, moving: followed.rows, still: still.rows };
        let errors =
            Errors { series, class, inertia, statics, coverage, outside_training_range, frequency_hz };
        Ok((errors, motion))
    };
    let (all, motions): (Vec<Errors>, Vec<Motion>) =
        folders.iter().map(compare).collect::<Result<Vec<_>>>()?.into_iter().unzip();
    if let Some(picture) = picture {
        curves::figure(&motions).save(picture)?;
    }
    if as_json {
        return output::json(&all);
    }
    let names = SERIES_COLUMNS[FIRST..].iter().map(|name| format!("{name:>17}")).collect::<String>();
    output!(
        "root mean square error in % of the range, of positions in % of the length of the tip's range, contact force as mean over 10 ms; \
         within: values of the motion within their half-widths, %"
    )?;
    output!("{:<9}{:<9}{names}  series", "class", "model")?;
    for errors in &all {
        let lines = [("inertia", &errors.inertia), ("static", &errors.statics), ("within", &errors.coverage)];
        for (name, values) in lines {
            let cell = |value: &Option<f64>| value.map_or(format!("{:>17}", "-"), |v| format!("{v:>17.2}"));
            let cells = values.iter().map(cell).collect::<String>();
            output!("{:<9}{name:<9}{cells}  {}", errors.class, errors.series.display())?;
        }
        if let Some([truth, model]) = errors.frequency_hz {
            let off = 100.0 * (model / truth - 1.0);
            output!("         frequency {model:.3} Hz, finite elements {truth:.3} Hz ({off:+.2} %)")?;
        }
        if errors.outside_training_range > 0 {
            output!("         {} instants are outside of the training range", errors.outside_training_range)?;
        }
    }
    Ok(())
}

fn read(path: &Path) -> Result<Vec<[f64; SERIES]>> {
    let wrong = |diagnostics| refusal(FormatError::Content { path: path.into(), diagnostics });
    let table = Table::read(path, true).map_err(refusal)?;
    let columns = table.columns(SERIES_COLUMNS).map_err(wrong)?;
    let mut diagnostics: Vec<Diagnostic> = Vec::new();
    let mut rows = Vec::new();
    for row in table.rows() {
        rows.push(columns.map(|column| match row.optional_number(column) {
            Ok(value) => value.unwrap_or(f64::NAN),
            Err(diagnostic) => {
                diagnostics.push(diagnostic);
                f64::NAN
            }
        }));
    }
    if diagnostics.is_empty() { Ok(rows) } else { Err(wrong(diagnostics)) }
}

/// Values of a motion within their half-widths, %; the force as mean over the window.
fn coverage(truth: &[[f64; SERIES]], found: &Followed<[f64; SERIES]>) -> [Option<f64>; SERIES - FIRST] {
    std::array::from_fn(|k| {
        let at = FIRST + k;
        let width = |widths: &[f64; 3]| match at {
            FORCE => widths[1],
            STRESS => widths[2],
            _ => widths[0],
        };
        let (truth, answers) = (column(truth, at), column(&found.rows, at));
        let moves = truth.iter().any(|v| *v != truth[0]);
        let rows = truth.iter().zip(&answers).zip(&found.half_widths);
        let known = rows.clone().filter(|(_, widths)| width(widths).is_finite()).count();
        let inside = rows.filter(|((a, b), widths)| (*a - *b).abs() <= width(widths)).count();
        (moves && known > 0).then(|| 100.0 * inside as f64 / known as f64)
    })
}

/// Values of a quantity at all instants.
fn column(rows: &[[f64; SERIES]], at: usize) -> Vec<f64> {
    if at == FORCE { means(rows) } else { rows.iter().map(|row| row[at]).collect() }
}

fn errors(truth: &[[f64; SERIES]], found: &[[f64; SERIES]]) -> [Option<f64>; SERIES - FIRST] {
    let range = |at: usize| {
        let values = column(truth, at);
        let (low, high) =
            values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
        high - low
    };
    let tip = TIP.map(range).iter().map(|range| range * range).sum::<f64>().sqrt();
    std::array::from_fn(|k| {
        let at = FIRST + k;
        let (truth, found) = (column(truth, at), column(found, at));
        let scale = if matches!(at, FORCE | STRESS) { range(at) } else { tip };
        let square =
            truth.iter().zip(&found).map(|(a, b)| (a - b) * (a - b)).sum::<f64>() / truth.len() as f64;
        (scale > 0.0).then(|| 100.0 * square.sqrt() / scale)
    })
}

/// Mean of the force over a window about each instant; forces are straight lines between the rows.
fn means(rows: &[[f64; SERIES]]) -> Vec<f64> {
    let mut impulse = vec![0.0];
    for pair in rows.windows(2) {
        let last = impulse[impulse.len() - 1];
        impulse.push(last + 0.5 * (pair[0][FORCE] + pair[1][FORCE]) * (pair[1][0] - pair[0][0]));
    }
    let (begin, end) = (rows[0][0], rows[rows.len() - 1][0]);
    let until = |t: f64| {
        let i = rows.partition_point(|row| row[0] <= t).clamp(1, rows.len() - 1) - 1;
        let part = (t - rows[i][0]) / (rows[i + 1][0] - rows[i][0]);
        let force = rows[i][FORCE] + part * (rows[i + 1][FORCE] - rows[i][FORCE]);
        impulse[i] + 0.5 * (rows[i][FORCE] + force) * (t - rows[i][0])
    };
    let mean = |row: &[f64; SERIES]| {
        let (from, to) =
            ((row[0] - 0.5 * FORCE_WINDOW_S).max(begin), (row[0] + 0.5 * FORCE_WINDOW_S).min(end));
        (until(to) - until(from)) / (to - from)
    };
    rows.iter().map(mean).collect()
}
