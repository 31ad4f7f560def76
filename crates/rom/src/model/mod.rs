//! The trained model: what a twin needs to answer, and how it lies in a file.

mod check;
mod codec;
mod file;
mod further;
mod header;
mod selection;
mod version2;

pub use file::{BlockEntry, FIXED_VERSION, MAGIC, ModelFileError, ModelReader, PLAIN_VERSION, VERSION};
pub use header::{
    BlockData, BlockKind, Clearance, FarOnset, ForceModel, GroupModel, Model, ModelHeader, OutputField,
    RegimeModel, truncation_error,
};
pub use selection::{ModelError, Nodes, Selection};
