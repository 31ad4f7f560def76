//! Unit tests of private parts: elements, assembly, checks of meshes.

#[path = "../common/actuators.rs"]
mod actuators;
#[path = "../common/builder.rs"]
mod builder;
mod laws;
mod meshes;
mod patches;
mod physics;
mod potential;
mod tangents;

use crate::mesh::Mesh;

/// Reproducible pseudo-random number in -1 to 1 for each k.
fn noise(k: usize) -> f64 {
    let mut h = (k as u64).wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    h = (h ^ (h >> 31)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    ((h ^ (h >> 29)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}
