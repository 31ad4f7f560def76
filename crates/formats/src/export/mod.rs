//! States as files of other programs: VTU with a PVD index (ParaView), Tecplot ASCII, XDMF, CSV, NPY.
//!
//! States are written one after the other: one state is in memory at a time.

mod csv;
mod label;
mod npy;
mod pvd;
mod series;
mod state;
mod tecplot;
mod writer;
mod xdmf;

pub use label::Label;
pub use series::{Moment, Series};
pub use state::StateFormat;
pub use writer::SeriesFormat;
