//! One state or many as files that people open: VTU with a PVD index (ParaView), Tecplot ASCII, XDMF, CSV, NPY.
//!
//! States are taken one after the other and written as they come: one state is in memory at a time.

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
