//! VTK's XML unstructured grids, as ParaView, meshio and PyVista read and write them.

pub(crate) mod codec;
mod read;
mod write;

pub use read::{Content, Quantity, parse, parse_content, read, read_content};
pub use write::{Cells, Grid, PointData, write, write_labelled};
