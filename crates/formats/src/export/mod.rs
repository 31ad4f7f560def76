//! Many states as one file: VTU with a PVD index (ParaView), Tecplot ASCII, XDMF, CSV, NPY.
//!
//! States are taken one after the other and written as they come: one state is in memory at a time.

mod csv;
mod layout;
mod npy;
mod pvd;
mod series;
mod tecplot;
mod writer;
mod xdmf;

pub use series::{Moment, Series};
pub use writer::SeriesFormat;

pub(crate) use pvd::write_vtu;
