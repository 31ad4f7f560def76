//! Recordings of a bench as quantities, and checks of them against each other and against a model.

use crate::files;
use crate::picture::{Axis, Figure, Mark, Panel, Series as Line};
use formats::log::{Mapping, Recording, Series};
use rom::inputs::{GAP, Inputs};
use rom::model::ModelHeader;
use std::path::{Path, PathBuf};

/// Ratios of units that are taken for one another.
const KNOWN_RATIOS: [(f64, &str); 7] = [
    (6.895, "psi taken for kPa"),
    (10.0, "bar for MPa, mm for cm"),
    (57.3, "degrees for radians"),
    (100.0, "bar for kPa"),
    (145.04, "psi taken for MPa"),
    (1000.0, "kPa taken for MPa, m for mm"),
    (1e6, "Pa taken for MPa"),
];
/// Ratio of a column's largest value to that of the model's range from which the unit is refused, and from which it is remarked.
const REFUSED_RATIO: f64 = 3.0;
const SMALL_RATIO: f64 = 1.0 / 5.0;
/// Pressures of soft actuators, MPa; lengths, mm.
const PLAUSIBLE_MPA: [f64; 2] = [1e-4, 2.0];
const PLAUSIBLE_MM: [f64; 2] = [0.05, 5000.0];
/// Most points of a line in a picture.
const MAX_POINTS: usize = 2000;

/// Reads a recording with its mapping.
pub fn read(recording: &Path, mapping: &Mapping) -> anyhow::Result<Recording> {
    let mut found = mapping.read_run(recording).map_err(files::refusal)?;
    let all: Vec<&Series> = found.inputs.iter().chain(&found.outputs).collect();
    let remarks: Vec<String> = all.into_iter().filter_map(implausible).collect();
    found.remarks.extend(remarks);
    Ok(found)
}

/// Reads a mapping.
pub fn mapping(path: &Path) -> anyhow::Result<Mapping> {
    Mapping::read(path).map_err(files::refusal)
}

/// Several recordings, as the command line names them.
pub fn read_all(recordings: &[PathBuf], log: &Path) -> anyhow::Result<Vec<Recording>> {
    let mapping = mapping(log)?;
    recordings.iter().map(|path| read(path, &mapping)).collect()
}

fn largest(values: &[f64]) -> f64 {
    values.iter().filter(|v| v.is_finite()).fold(0.0, |most: f64, v| most.max(v.abs()))
}

/// Largest minus smallest finite value.
pub fn range(values: &[f64]) -> f64 {
    let finite = values.iter().filter(|v| v.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    (high - low).max(0.0)
}

fn implausible(series: &Series) -> Option<String> {
    let (size, range) = (largest(&series.values), range(&series.values));
    let (limits, unit, size) = match series.name.rsplit('_').next() {
        Some("mpa") => (PLAUSIBLE_MPA, "MPa", size),
        Some("mm") => (PLAUSIBLE_MM, "mm", range),
        _ => return None,
    };
    let is_off = range > 0.0 && !(limits[0]..=limits[1]).contains(&size);
    is_off.then(|| format!("{}: {size:.3e} {unit} at most; is its unit in the mapping right?", series.name))
}

/// The confusion of units that a ratio fits within 30 %.
pub fn confusion(ratio: f64) -> &'static str {
    let ratio = if ratio < 1.0 { 1.0 / ratio } else { ratio };
    let near = KNOWN_RATIOS.iter().find(|(known, _)| (0.77..1.3).contains(&(ratio / known)));
    near.map_or("no known confusion of units", |(_, name)| name)
}

/// Position of each model input in the recording's inputs; gap is not needed where nothing is touched, nor an input with a value of the
/// model or scene, which a remark then names.
///
/// # Errors
/// Inputs that the recording lacks, or whose values are in another unit.
pub fn match_inputs(
    header: &ModelHeader,
    recording: &Recording,
    remarks: &mut Vec<String>,
) -> Result<Vec<Option<usize>>, anyhow::Error> {
    let needs = header.needs();
    let mut found = Vec::new();
    for (at, spec) in header.inputs.iter().enumerate() {
        let key = spec.key();
        let place = recording.inputs.iter().position(|series| series.name == key);
        let is_needed = match at {
            0 => needs.pressure,
            GAP => needs.gap,
            // An inertial load at rest, a parameter of the scene: as along a trace of `predict`.
            _ => spec.value.is_none() && spec.range[0] < spec.range[1],
        };
        let Some(place) = place else {
            if is_needed {
                let names: Vec<&str> = recording.inputs.iter().map(|s| s.name.as_str()).collect();
                anyhow::bail!(
                    "expected an input `{key}` of the model in the mapping, found {}",
                    names.join(", ")
                );
            }
            if let Some(value) = spec.value.filter(|_| spec.range[0] < spec.range[1]) {
                remarks.push(format!("{key}: not in the recording; taken as {value} {}", spec.unit));
            }
            found.push(None);
            continue;
        };
        let (own, of_model) =
            (largest(&recording.inputs[place].values), spec.range[0].abs().max(spec.range[1].abs()));
        let ratio = own / of_model;
        if is_needed && of_model.is_finite() && ratio.is_finite() {
            let message = format!(
                "{key}: the model's range is {:.4} .. {:.4} {}, the recording's values go up to {own:.4}: a factor {ratio:.3} ({})",
                spec.range[0],
                spec.range[1],
                spec.unit,
                confusion(ratio)
            );
            if ratio > REFUSED_RATIO {
                anyhow::bail!("{message}; correct its unit in the mapping");
            }
            if ratio < SMALL_RATIO {
                remarks.push(message);
            }
        }
        found.push(Some(place));
    }
    Ok(found)
}

/// Inputs of a row; `None` if one is missing.
pub fn inputs_at(places: &[Option<usize>], recording: &Recording, row: usize) -> Option<Inputs> {
    let start = Inputs::new(f64::NAN, f64::INFINITY);
    let mut inputs = start;
    for (at, place) in places.iter().enumerate() {
        if let Some(place) = place {
            let value = recording.inputs[*place].values[row];
            if !value.is_finite() {
                return None;
            }
            inputs = inputs.with(at, value);
        }
    }
    // A pressure that no answer depends on.
    Some(if inputs.pressure_mpa().is_nan() { inputs.with(0, 0.0) } else { inputs })
}

/// A line of at most some thousand points.
pub fn line(name: &str, colour: usize, mark: Mark, points: impl Iterator<Item = (f64, f64)>) -> Line {
    let points: Vec<(f64, f64)> = points.filter(|(x, y)| x.is_finite() && y.is_finite()).collect();
    let step = points.len().div_ceil(MAX_POINTS).max(1);
    Line { name: name.into(), colour, mark, points: points.into_iter().step_by(step).collect() }
}

pub fn panel(title: &str, x: &str, y: &str, series: Vec<Line>) -> Panel {
    Panel { title: title.into(), x: Axis::linear(x), y: Axis::linear(y), series, map: None }
}

/// All quantities of a recording over time.
pub fn figure(recording: &Recording, title: &str) -> Figure {
    let one = |series: &Series| {
        let points = recording.time_s.iter().copied().zip(series.values.iter().copied());
        panel("", "time [s]", &series.name, vec![line("", 0, Mark::Line, points)])
    };
    let panels = recording.inputs.iter().chain(&recording.outputs).map(one).collect();
    Figure { title: title.into(), panels, columns: 3 }
}
