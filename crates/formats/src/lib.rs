//! Files: what people and other programs read and write. One file a format; nothing here is linked into the daemon.
//!
//! Every reader treats its input as hostile: sizes are checked against the bytes that are there before anything is
//! allocated, and a refusal lists everything that is wrong as *where / expected / found*.
#![forbid(unsafe_code)]

pub mod authors;
pub mod database;
pub mod error;
pub mod export;
pub mod fields;
pub mod import;
pub mod mesh_file;
pub mod msh;
pub mod npy;
pub mod packed;
pub mod vtu;

pub use error::{Diagnostic, FormatError};
