//! Pictures: a [`Figure`] is data; [`Figure::save`] draws it as SVG or PNG, by the file's ending.
//!
//! The same drawing code serves both. Text needs no font of the machine: a font comes with the program.

mod draw;
mod scale;

use std::path::Path;

/// Colours that stay apart for colour-blind eyes and in grey, by index.
const COLOURS: [(u8, u8, u8); 6] =
    [(0, 84, 147), (213, 94, 0), (0, 135, 90), (150, 60, 140), (90, 90, 90), (200, 150, 0)];

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
    /// What is drawn, in order.
    pub series: Vec<Series>,
    /// Values drawn as colours behind the series.
    pub map: Option<Map>,
}

/// An axis: its label says quantity and unit.
#[derive(Default)]
pub struct Axis {
    /// `pressure [MPa]`.
    pub label: String,
    /// Logarithmic, base 10; values that are not positive are left out.
    pub log: bool,
    /// Names at 0, 1, 2, ... instead of numbers.
    pub names: Vec<String>,
}

impl Axis {
    /// A linear axis.
    pub fn linear(label: &str) -> Self {
        Self { label: label.into(), ..Self::default() }
    }

    /// A logarithmic axis.
    pub fn log(label: &str) -> Self {
        Self { label: label.into(), log: true, ..Self::default() }
    }

    /// An axis of names.
    pub fn names(label: &str, names: Vec<String>) -> Self {
        Self { label: label.into(), log: false, names }
    }
}

/// How a series looks.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    /// A line.
    Line,
    /// Dots.
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
    /// What the colours mean, with unit.
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

    /// Draws the figure into a `.svg` or `.png` file.
    ///
    /// # Errors
    /// Another ending, or what drawing or the operating system refuses.
    pub fn save(&self, path: &Path) -> anyhow::Result<()> {
        match path.extension().and_then(|e| e.to_str()) {
            Some("svg") => crate::files::save(path, draw::svg(self)?.as_bytes()),
            Some("png") => crate::files::save(path, &draw::png(self)?),
            _ => Err(crate::failure::usage(format!("{}: a picture ends in .svg or .png", path.display()))),
        }
    }
}
