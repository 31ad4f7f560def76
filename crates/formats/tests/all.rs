//! Files read and written, by format. One program: linked once, tests in parallel.

mod authors;
mod common;
mod database;
mod export_series;
mod import_abaqus;
mod log;
mod msh_reader;
mod npy;
mod packed;
mod results;
mod results_beside;
#[allow(dead_code, reason = "shared by several test programs")]
#[path = "../../../tests/src/synthetic/mod.rs"]
mod synthetic;
mod vtu_reader;
mod vtu_writer;
