//! Distributions as a picture: the fraction of samples slower than a time.

use super::measure::Durations;
use softtwin::picture::{self, Axis, Figure, Mark, Panel};
use std::path::Path;

/// Curves a panel: as many as there are colours that stay apart.
const CURVES: usize = 6;

/// Draws all series that have samples. Both axes are logarithmic, so that median and tail are seen together.
pub fn draw(path: &Path, series: &[Durations]) -> anyhow::Result<()> {
    let measured: Vec<&Durations> = series.iter().filter(|s| !s.is_empty()).collect();
    let panels = measured.chunks(CURVES).map(panel).collect();
    let title = "Share of samples slower than a time".into();
    Figure { title, panels, columns: 2 }.save(path)
}

fn panel(series: &[&Durations]) -> Panel {
    let curve = |(colour, series): (usize, &&Durations)| picture::Series {
        name: series.name.clone(),
        colour,
        mark: Mark::Line,
        points: series.tail(),
    };
    Panel {
        title: String::new(),
        x: Axis::log("time [us]"),
        y: Axis::log("share slower"),
        series: series.iter().enumerate().map(curve).collect(),
        map: None,
    }
}
