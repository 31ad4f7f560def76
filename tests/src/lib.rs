//! Shared parts of the multi-process tests: a small trained model, scenes with it, and controlled processes.
//!
//! Every test has its own [`Stage`]: a temporary folder and a shared-memory domain. Tests synchronise on printed lines, samples
//! or polled conditions, and fail after [`PATIENCE`].

pub mod cantilever;
pub mod http;
pub mod inputs;
pub mod kills;
pub mod manager;
pub mod measured;
pub mod modules;
pub mod moving;
pub mod process;
pub mod skip;
pub mod stage;
pub mod synthetic;
pub mod wait;

pub use manager::Manager;
pub use measured::{learned_model, learned_model_with_force};
pub use process::Program;
pub use stage::Stage;
pub use studies::verify::Verifier;

use std::time::Duration;

/// Time after which a waiting test fails; long enough for a loaded machine.
pub const PATIENCE: Duration = Duration::from_secs(60);
