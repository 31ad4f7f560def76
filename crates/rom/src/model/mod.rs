//! The trained model: what a twin needs to answer, and how it lies in a file.

mod check;
mod codec;
mod file;
mod header;
mod part;
mod selection;

pub use file::{BlockEntry, Encoding, MAGIC, MAX_MODEL_BYTES, ModelFileError, ModelReader, VERSION};
pub use header::{
    BlockData, BlockKind, Clearance, FarOnset, ForceModel, GroupModel, Model, ModelHeader, OutputField,
    PressureLimit, RegimeModel, truncation_error,
};
pub use selection::{ModelError, Nodes, Selection};

/// Hexadecimal digits, as people read the hash of a model.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
