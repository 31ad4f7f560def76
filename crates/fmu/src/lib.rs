//! FMU of a model for FMI 3.0 (co-simulation and model exchange): the library in `binaries/`, and the description that `softtwin
//! export` writes. Outputs of a static model follow from inputs without delay; a model with
//! memory or inertia steps a session.
//!
//! FMI's interface is hand-written: generators of FMUs in Rust require the variables at compile time, but they are those of the
//! model in `resources/`. Unsupported functions return `fmi3Error` and log their name.
//!
//! Cost of the outputs: one evaluation without coefficients for force, gradients, onset and half-widths; the coefficients of the
//! fields for fields at nodes; a reconstruction of the whole stress for its largest value. Each is computed when it is read, once
//! for the same inputs.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod description;
#[allow(non_snake_case)] // names of FMI
mod ffi;
mod instance;

pub use description::{ChosenNode, IDENTIFIER, MODEL_FILE, NODES_FILE, describe, nodes_text, token};

/// Declarations of the exported functions in C.
pub const DECLARATIONS: &str = include_str!("../softtwin_fmi3.h");
