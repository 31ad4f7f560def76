//! Data of a figure.

use super::axis::Axis;
use std::ops::Range;

/// A picture of one or more panels.
pub struct Figure {
    /// Heading.
    pub title: String,
    /// Panels, row after row.
    pub panels: Vec<Panel>,
    /// Panels in a row.
    pub columns: usize,
}

/// One system of axes.
pub struct Panel {
    /// Heading.
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
    /// Both.
    LineDots,
}

/// Points that belong together.
pub struct Series {
    /// Name in the legend; an empty one is not listed.
    pub name: String,
    /// Colour by index, around and around.
    pub colour: usize,
    /// Look.
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

impl Panel {
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
