//! The trained model: what a twin needs to answer, and how it lies in a file.

mod check;
mod codec;
mod file;
mod header;
mod selection;
mod version2;

pub use file::{BlockEntry, MAGIC, ModelFileError, ModelReader, VERSION};
pub use header::{
    BlockData, BlockKind, FarOnset, ForceModel, GroupModel, Model, ModelHeader, OutputField, RegimeModel,
};
pub use selection::{ModelError, Nodes, Selection};
