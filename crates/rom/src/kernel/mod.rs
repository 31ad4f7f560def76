//! The reconstruction kernel: modal coefficients to nodal fields in one linear sweep through memory.
//!
//! For every published field and node `i` it computes (the paper's Eq. 7 with a mean)
//!
//! ```text
//! y_i = mean_i + sum_j phi_ij a_j        coordinates, stress, any other field
//! U_i = |x_i - x0_i|                     displacement magnitude, derived from three coordinates
//! S_i = max(S_i, 0)                      von Mises stress
//! ```
//!
//! and finds the largest displacement and the largest stress with their nodes on the way.
//!
//! One reconstruction reads the basis once and writes the fields once: 8 flops per 4 bytes at most, so its time is the
//! time of moving the bytes. [`Modes`] therefore store them in the order of use, tiles of [`TILE_NODES`] nodes and in a tile
//! mode after mode, in memory as in a model file. The sweep passes over all fields of a tile together, so that derived fields
//! cost no second pass, and leaves out the last modes of a field where fewer are enough.
//!
//! The kernel sums of interpolants are here as well, for their instruction sets (`sums.rs`, `weigh.rs`) and means over the cases
//! around a state (`around.rs`).
//!
//! The reconstruction knows nothing of the model: [`Spec`] describes what to build from plain slices. The tests
//! hold every instruction set to the same equations computed in the plainest way and in f64.

pub(crate) mod around;
mod eight;
mod isa;
mod lanes;
mod modes;
mod pages;
pub(crate) mod plan;
pub(crate) mod sums;
pub(crate) mod sweep;
pub(crate) mod weigh;

pub use isa::Isa;
pub use modes::{Modes, NotFinite, Precision, Shape};
pub use plan::{Affine, BasisError, Field, FieldSource, Role, Shift, Spec};

/// Nodes per tile: four AVX-512 registers of f32, eight of AVX2, sixteen of NEON. More than one register holds, because
/// the control flow of a tile then costs less a node; with twice as many, sums no longer fit the registers.
pub const TILE_NODES: usize = 64;

/// Most modes and shifts, summed over the affine fields, that one basis may have. Their factors are on the stack of a
/// reconstruction, which does not allocate.
pub const MAX_ROWS: usize = 512;
