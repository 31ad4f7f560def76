#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

pub mod abaqus;
pub mod cells;
pub mod database;
mod error;
pub mod export;
pub mod file;
pub mod log;
pub mod mesh_file;
mod mesh_reader;
pub mod msh;
pub mod npy;
pub mod packed;
pub mod results;
pub mod table;
pub mod trace;
pub mod unit;
pub mod vtu;

pub use error::{Diagnostic, FormatError, collect};
pub use mesh_reader::{read_blocks, read_mesh};
