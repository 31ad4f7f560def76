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
//! and in a tile, field after field, the mean and the modes as rows of 32 values. The sweep touches each cache line
//! once, in order, and all fields of a node are at hand together, so that derived fields cost no second pass.
//! [`Precision::I16`] halves the bytes of the modes (a scale per mode; mean and rest shape stay f32).
//!
//! The module knows nothing of the model: [`Spec`] describes what to build from plain slices. [`reference`] computes
//! the same in the plainest way and in f64; tests hold every instruction set to it.

mod basis;
mod isa;
mod lanes;
mod plan;
pub mod reference;
mod spec;
mod sweep;
mod tiles;

#[cfg(test)]
mod tests;

pub use basis::{Basis, Peak, Peaks, ReconstructError};
pub use isa::Isa;
pub use spec::{Affine, BasisError, Field, Role, Source, Spec, Values};
pub use tiles::Precision;

/// Nodes a tile: two AVX-512 registers of f32, four of AVX2, eight of NEON. Twice what one register holds, because the
/// control flow of a tile then costs half as much a node.
pub const TILE_NODES: usize = 32;

/// Most coefficients, summed over the affine fields, that one basis may use. They live on the stack of a
/// reconstruction, which must not allocate.
pub const MAX_COEFFICIENTS: usize = 512;
