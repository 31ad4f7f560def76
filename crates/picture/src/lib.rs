//! Pictures without a display or a graphics card.
//!
//! `chart`: figures of axes, curves and maps as SVG or PNG. The other modules render bodies: [`skin`] makes lit corners
//! from nodes and facets, `raster` fills pixels with a depth buffer, [`scene`] combines body, plate, light and shadow,
//! [`sheet`] arranges scenes with labels and a colour bar, [`states`] states of bodies on a sheet. Colours, fonts and PNG files are
//! the same for both.
#![forbid(unsafe_code)]

pub mod camera;
pub mod canvas;
mod chart;
pub mod colour;
mod raster;
pub mod scale;
pub mod scene;
mod shadow;
pub mod sheet;
pub mod skin;
pub mod states;
mod text;
pub mod theme;
pub mod visible;

pub use chart::{Axis, EndingError, Figure, Map, Mark, Panel, Series};
