//! VTK's XML unstructured grids, as ParaView, meshio and PyVista read and write them.

mod codec;
mod read;
mod write;

pub use read::{parse, read};
pub use write::{Block, Cells, Grid, PointData, write, write_labelled};
