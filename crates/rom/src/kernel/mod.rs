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
//! One reconstruction reads the basis once and writes the fields once: 8 flops per 4 bytes at most, so the time is the
//! time of moving the bytes. [`Basis`] therefore stores them in the order of use: tiles of [`TILE_NODES`] nodes,
//! and in a tile, field after field, the mean and the modes as rows of 64 values. The sweep touches each cache line
//! once, in order, and all fields of a node are at hand together, so that derived fields cost no second pass.
//! [`Precision::I16`] halves the bytes (a scale per row: mode, mean or rest shape). With a [`Budget`] every group of tiles has
//! modes of its own, fewer and each as wide as the error that is accepted for its field lets it be.
//!
//! What an evaluation of the model needs before is here as well, for its instruction sets: the kernel sums of interpolants (`approach.rs`,
//! `weigh.rs`, `tail.rs`) and means over the cases around a state (`around.rs`).
//!
//! The reconstruction knows nothing of the model: [`Spec`] describes what to build from plain slices. The tests
//! hold every instruction set to the same equations computed in the plainest way and in f64.

pub(crate) mod approach;
pub(crate) mod around;
mod basis;
mod budget;
mod eight;
mod isa;
mod lanes;
mod local;
mod local_modes;
mod local_rows;
mod pages;
mod peak;
mod plan;
mod rows;
mod spec;
mod sweep;
pub(crate) mod tail;
mod tiles;
pub(crate) mod weigh;
mod whole;

pub use basis::{Basis, Peak, Peaks, ReconstructError};
pub use budget::Budget;
pub use isa::Isa;
pub use peak::PeakSearch;
pub use spec::{Affine, BasisError, Field, Role, Shift, Shortfall, Source, Spec, Values};
pub use tiles::Precision;

/// Nodes a tile: four AVX-512 registers of f32, eight of AVX2, sixteen of NEON. More than one register holds, because
/// the control flow of a tile then costs less a node; with twice as many, sums no longer fit the registers.
pub const TILE_NODES: usize = 64;

/// Most rows (means, modes and rest coordinates, summed over the affine fields) that one basis may have. Their factors
/// live on the stack of a reconstruction, which must not allocate.
pub const MAX_ROWS: usize = 512;
