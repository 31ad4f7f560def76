//! Data of a figure.

use super::axis::Axis;
use std::ops::Range;

/// A picture of one or more panels.
pub struct Figure {
    pub title: String,
    /// Panels, row after row.
    pub panels: Vec<Panel>,
    /// Panels in a row.
    pub columns: usize,
}

/// One system of axes.
pub struct Panel {
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Series, in drawing order.
    pub series: Vec<Series>,
    /// Values drawn as colours behind the series.
    pub map: Option<Map>,
}

/// How a series looks.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    Line,
    Dots,
    /// A line with a dot at each point.
    LineDots,
}

/// Points that belong together.
pub struct Series {
    /// Name in the legend; an empty one is not listed.
    pub name: String,
    /// Colour by index, around and around.
    pub colour: usize,
    pub mark: Mark,
    /// `(x, y)`.
    pub points: Vec<(f64, f64)>,
}

/// A quantity over a grid, the first row at the bottom.
pub struct Map {
    /// Quantity of the colours, with unit.
    pub label: String,
    /// Horizontal extent.
    pub x: [f64; 2],
    /// Vertical extent.
    pub y: [f64; 2],
    /// Cells in a row.
    pub columns: usize,
    /// Values row after row; NaN is left blank.
    pub values: Vec<f64>,
}

impl Figure {
    /// A figure of one panel.
    pub fn one(title: &str, panel: Panel) -> Self {
        Self { title: title.into(), panels: vec![panel], columns: 1 }
    }
}

/// Most points of a line: more than a picture has columns.
const MAX_POINTS: usize = 2000;

impl Series {
    /// The finite points. Of each stretch of a longer line the lowest and the highest stay, so nothing that stands out is lost.
    pub fn new(
        name: impl Into<String>,
        colour: usize,
        mark: Mark,
        points: impl IntoIterator<Item = (f64, f64)>,
    ) -> Self {
        let finite = points.into_iter().filter(|(x, y)| x.is_finite() && y.is_finite());
        let mut points: Vec<(f64, f64)> = finite.collect();
        let stretch = (2 * points.len()).div_ceil(MAX_POINTS);
        if mark == Mark::Line && stretch > 2 {
            points = points.chunks(stretch).flat_map(extremes).collect();
        }
        Self { name: name.into(), colour, mark, points }
    }

    pub fn line(
        name: impl Into<String>,
        colour: usize,
        points: impl IntoIterator<Item = (f64, f64)>,
    ) -> Self {
        Self::new(name, colour, Mark::Line, points)
    }
}

/// The lowest and the highest point, in their order.
fn extremes(part: &[(f64, f64)]) -> impl Iterator<Item = (f64, f64)> {
    let by_value = |a: &usize, b: &usize| part[*a].1.total_cmp(&part[*b].1);
    let ends = [(0..part.len()).min_by(by_value), (0..part.len()).max_by(by_value)];
    let first = ends.iter().min().copied().flatten();
    let last = ends.iter().max().copied().flatten().filter(|last| Some(*last) != first);
    first.into_iter().chain(last).map(|at| part[at])
}

impl Panel {
    /// Series in a system of axes; a label is a linear axis.
    pub fn new(
        title: impl Into<String>,
        x: impl Into<Axis>,
        y: impl Into<Axis>,
        series: Vec<Series>,
    ) -> Self {
        Self { title: title.into(), x: x.into(), y: y.into(), series, map: None }
    }

    /// Ranges of both axes.
    pub(super) fn ranges(&self) -> (Range<f64>, Range<f64>) {
        let points = || self.series.iter().flat_map(|s| &s.points);
        match &self.map {
            Some(map) => (map.x[0]..map.x[1], map.y[0]..map.y[1]),
            None => (self.x.range(points().map(|p| p.0)), self.y.range(points().map(|p| p.1))),
        }
    }
}

impl Map {
    /// Smallest and largest finite value.
    pub(super) fn limits(&self) -> (f64, f64) {
        let finite = self.values.iter().copied().filter(|v| v.is_finite());
        finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_line_is_short_and_keeps_extremes() {
        let mut points: Vec<(f64, f64)> = (0..100_000).map(|i| (f64::from(i), 1.0)).collect();
        (points[33_333].1, points[77_777].1) = (500.0, -3.0);
        let thin = Series::line("", 0, points.iter().copied()).points;
        assert!(thin.len() <= MAX_POINTS + 2 && thin.windows(2).all(|pair| pair[0].0 <= pair[1].0));
        assert!(thin.contains(&(33_333.0, 500.0)) && thin.contains(&(77_777.0, -3.0)));
        let short = Series::line("", 0, points[..MAX_POINTS].iter().copied());
        assert_eq!(short.points, points[..MAX_POINTS]);
    }
}
