//! Finished simulations of other programs, one file or folder each, and the database that is made of them.
//!
//! | ending | content | reader |
//! | --- | --- | --- |
//! | `.frd` | CalculiX, ASCII; an unconverged last state is left out | `frd.rs` |
//! | `.dat` of the same name | total forces of node sets | `frd.rs` |
//! | `.vtu` | VTK, one step | `vtk.rs` |
//! | `.pvd` | ParaView's list of `.vtu` files, one step each | `vtk.rs` |
//! | `.inp` | Abaqus mesh; the results are in a `.csv` or `.npz` of the same name | `nodal.rs` |
//! | `.npz` | the arrays of a folder in one archive | `stacks.rs` |
//! | a folder | NumPy arrays: `points.npy`, `tetra10.npy`, `displacement.npy` (steps x nodes x 3), ... | `stacks.rs` |
//!
//! `softtwin-convert` of the Python client writes the `.npz` from XDMF, FEBio and Ansys files.

mod assemble;
mod collect;
mod frd;
mod labels;
mod nodal;
mod run;
mod stacks;
mod vtk;

pub use assemble::{Assembly, Wanted};
pub use collect::{ImportOptions, ImportedStates, collect, input_ranges, plain_name, read};
pub use frd::{parse as parse_frd, parse_dat};
pub use labels::{ImportError, InputSource};
pub use run::{NodalQuantity, Run, Step, Total};
pub use stacks::parse_archive as parse_npz;
pub use vtk::parse_list as parse_pvd;
