//! What the programs share at the command line: errors and exit codes, output, ranges of arguments, child processes,
//! samples as text, latencies, files that come with the programs; and the demonstration, which `softtwin demo` and the
//! program `softtwin-demo` are.
#![forbid(unsafe_code)]
// Results go through `output!`, which survives a closed pipe; `println!` would panic there.
#![warn(clippy::print_stdout)]

pub mod daemon;
pub mod demo;
pub mod failure;
pub mod latency;
pub mod output;
pub mod range;
pub mod shared_files;
pub mod text;
