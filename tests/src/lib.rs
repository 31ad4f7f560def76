//! What the multi-process stories share: a small trained model, scenes around it, and processes under control.
//!
//! Every story has its own [`Stage`]: a temporary folder and a shared-memory domain that nobody else is in. Nothing here
//! sleeps to synchronise: stories wait for lines that a program prints, or for samples, with generous time-outs.

pub mod cantilever;
pub mod http;
pub mod inputs;
pub mod kills;
pub mod manager;
pub mod modules;
pub mod process;
pub mod skip;
pub mod stage;
pub mod wait;

pub use manager::Manager;
pub use process::Program;
/// The beam that bends until it meets a plate, with its exact answers.
pub use rom::synthetic;
pub use stage::Stage;
pub use studies::verify::Verifier;

use std::time::Duration;

/// How long a story waits for anything before it fails: long enough for a loaded machine.
pub const PATIENCE: Duration = Duration::from_secs(60);
