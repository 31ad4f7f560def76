//! Files read and written, by format. One program: linked once, tests in parallel.

mod authors;
mod common;
mod database;
mod export_series;
mod import_abaqus;
mod msh_reader;
mod npy;
mod packed;
mod results;
mod results_beside;
mod vtu_reader;
mod vtu_writer;
