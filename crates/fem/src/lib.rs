//! The actuator's own finite elements: from a mesh to deformed, stressed, touching states.
//!
//! Lengths are millimetres, forces newtons, stresses megapascals, masses tonnes (so that mm/s2 x t = N).
//!
//! [`problem::Problem`] checks mesh and materials once; a [`solver::Solver`] per thread walks from state to state;
//! [`output::Output`] is what a state looks like. The formulation is written up in `docs/fem.md`.

#![forbid(unsafe_code)]

pub mod actuator;
pub mod algebra;
pub mod assemble;
pub mod config;
pub mod contact;
pub mod element;
pub mod energy;
pub mod linear;
pub mod material;
pub mod mesh;
pub mod newton;
pub mod ordering;
pub mod output;
pub mod problem;
pub mod rng;
pub mod run;
pub mod sample;
pub mod solver;
pub mod sparse;
pub mod state;

pub use config::{Load, ProblemConfig};
pub use contact::obstacle::Obstacle;
pub use output::Output;
pub use problem::{Problem, ProblemError};
pub use solver::{Report, SolveError, Solver};
pub use state::State;
