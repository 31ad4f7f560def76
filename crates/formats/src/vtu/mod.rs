//! VTK's XML unstructured grids, as ParaView, meshio and PyVista read and write them.

mod codec;
mod read;

pub use read::{parse, read};
