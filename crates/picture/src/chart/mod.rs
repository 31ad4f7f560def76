//! Figures of one or more systems of axes. The same drawing code serves SVG and PNG.

mod axis;
mod draw;
mod figure;

pub use axis::Axis;
pub use draw::EndingError;
pub use figure::{Figure, Map, Mark, Panel, Series};
