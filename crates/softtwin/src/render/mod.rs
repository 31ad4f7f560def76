//! Software rendering: states and modes to pictures, without a display or a graphics card.
//!
//! [`skin`] makes lit corners from nodes and facets, [`raster`] fills pixels with a depth buffer, [`scene`] puts body,
//! plate, light and shadow together, [`sheet`] arranges scenes with texts and a colour bar.

pub mod camera;
pub mod canvas;
pub mod colour;
mod raster;
pub mod scale;
pub mod scene;
mod shadow;
pub mod sheet;
pub mod skin;
pub mod text;
pub mod theme;
pub mod visible;
