//! A model as an FMU of FMI 3.0 (co-simulation and model exchange): the library in `binaries/`, and the description beside it,
//! which `softtwin export` writes. The FMU has no states: outputs follow from inputs at once.
//!
//! FMI's interface is written by hand: generators of FMUs in Rust want the variables when they are compiled; ours are those of
//! the model in `resources/`. Functions of FMI that such a model has no use for return `fmi3Error` and log their name.
//!
//! What an output costs: force, gradients, half-widths and nodes one evaluation, the largest stress the whole stress field;
//! each is computed when it is read, once for the same inputs.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

#[allow(non_snake_case)] // names are those of FMI
mod border;
mod description;
mod instance;
#[allow(non_snake_case)]
mod unsupported;
mod variables;

pub use description::{IDENTIFIER, describe};
pub use variables::{ChosenNode, MODEL_FILE, NODES_FILE, nodes_text, token};
