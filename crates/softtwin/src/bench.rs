//! Recordings of a bench: reading and drawing them.

use crate::files;
use crate::picture::{Figure, Panel, Series as Line};
use formats::log::{Mapping, Recording, Series};
use rom::statistics::range;
use std::path::{Path, PathBuf};

/// Pressures of soft actuators, MPa; lengths, mm.
const PLAUSIBLE_MPA: [f64; 2] = [1e-4, 2.0];
const PLAUSIBLE_MM: [f64; 2] = [0.05, 5000.0];

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

/// All quantities of a recording over time.
pub fn figure(recording: &Recording, title: &str) -> Figure {
    let over_time = |series: &Series| {
        let points = recording.time_s.iter().copied().zip(series.values.iter().copied());
        Panel::new("", "time [s]", series.name.as_str(), vec![Line::line("", 0, points)])
    };
    let panels = recording.inputs.iter().chain(&recording.outputs).map(over_time).collect();
    Figure { title: title.into(), panels, columns: 3 }
}
