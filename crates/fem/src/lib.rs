//! The actuator's own finite elements: from a mesh to deformed, stressed, touching states.
//!
//! Lengths are millimetres, forces newtons, stresses megapascals, masses tonnes (so that mm/s2 x t = N).

#![forbid(unsafe_code)]

pub mod mesh;
pub mod rng;
pub mod trace;
