//! The commands of `softtwin`, one file each under `cmd`, and what the program `softtwin-studies` shares with them:
//! errors and exit codes, files, output, progress, pictures.
#![forbid(unsafe_code)]
// Results go through `output!`, which survives a closed pipe; `println!` would panic there.
#![warn(clippy::print_stdout)]

mod cmd;
pub mod files;
mod live;
pub mod options;
pub mod progress;
pub mod range;
pub mod report;
pub mod resources;
pub mod unknowns;

pub use cmd::Command;
pub use picture;
pub use softtwind::{daemon, failure, help, output, shared_files};
