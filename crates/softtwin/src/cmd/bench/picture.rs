//! Distributions as a picture: the share of samples slower than a time.

use super::measure::Series;
use crate::picture::{self, Axis, Figure, Mark, Panel};
use std::path::Path;

/// Points a curve: enough for a picture, few enough for a small file.
const POINTS: usize = 400;
/// Curves a panel: as many as there are colours that stay apart.
const CURVES: usize = 6;

/// Draws all series that have samples. Both axes are logarithmic, so that median and tail are seen together.
pub fn draw(path: &Path, series: &[Series]) -> anyhow::Result<()> {
    let measured: Vec<&Series> = series.iter().filter(|s| s.len() > 0).collect();
    let panels = measured.chunks(CURVES).map(panel).collect();
    let title = "Share of samples slower than a time".into();
    Figure { title, panels, columns: 2 }.save(path)
}

fn panel(series: &[&Series]) -> Panel {
    let curve = |(colour, series): (usize, &&Series)| picture::Series {
        name: series.name.clone(),
        colour,
        mark: Mark::Line,
        points: tail(&series.sorted_us()),
    };
    Panel {
        title: String::new(),
        x: Axis::log("time [us]"),
        y: Axis::log("share slower"),
        series: series.iter().enumerate().map(curve).collect(),
        map: None,
    }
}

/// Time and share of samples at least as slow, at most about [`POINTS`]; the slowest sample's share is that of one sample.
fn tail(sorted_us: &[f64]) -> Vec<(f64, f64)> {
    let count = sorted_us.len();
    let step = (count / POINTS).max(1);
    // The rare end is what matters: every sample of the last percent is drawn.
    let drawn = |i: &usize| i.is_multiple_of(step) || i * 100 >= count * 99;
    (0..count).filter(drawn).map(|i| (sorted_us[i], (count - i) as f64 / count as f64)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tail_falls_from_all_to_one_sample() {
        let sorted: Vec<f64> = (1..=5000).map(f64::from).collect();
        let curve = tail(&sorted);
        assert_eq!(curve[0], (1.0, 1.0));
        assert_eq!(*curve.last().unwrap(), (5000.0, 1.0 / 5000.0));
        assert!(curve.windows(2).all(|w| w[0].0 < w[1].0 && w[0].1 > w[1].1) && curve.len() < 500);
    }
}
