//! Opening and saving what commands work on, with errors that say whose mistake it was.

use crate::failure::configuration;
use anyhow::Context;
use formats::database::{self, ObstacleKind};
use formats::{FormatError, file};
use rom::model::Model;
use rom::snapshots::Database;
use std::path::{Path, PathBuf};

/// Largest model file that is read: 4 GiB.
const MAX_MODEL_BYTES: u64 = 4 << 30;

/// Loads a whole model.
pub fn model(path: &Path) -> anyhow::Result<Model> {
    Ok(model_and_hash(path)?.0)
}

/// Loads a whole model with the hash at the file's end, whose first half stands in the headers of its fields.
pub fn model_and_hash(path: &Path) -> anyhow::Result<(Model, [u8; 32])> {
    let bytes = file::read_bytes(path, MAX_MODEL_BYTES)
        .map_err(refusal)
        .with_context(|| format!("cannot read the model {}; `softtwin train` makes one", path.display()))?;
    let model =
        Model::from_bytes(&bytes).with_context(|| path.display().to_string()).map_err(configuration)?;
    let hash = *bytes.last_chunk::<32>().context("the model file has no hash")?;
    Ok((model, hash))
}

/// Loads the cases of one scene of a database.
pub fn database(dir: &Path, scene: ObstacleKind) -> anyhow::Result<Database> {
    database::read(dir, scene).map_err(refusal)
}

/// Content the user can mend is a configuration error; the operating system's refusal is not.
pub fn refusal(error: FormatError) -> anyhow::Error {
    match error {
        FormatError::Io { .. } => error.into(),
        _ => configuration(error),
    }
}

/// Replaces a file as a whole: a reader sees the old one or the new one, never a part.
pub fn save(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    Ok(file::replace(path, bytes)?)
}

/// The data sheet's place: beside the model, `.json` instead of `.twin`.
pub fn data_sheet(model: &Path) -> PathBuf {
    model.with_extension("json")
}
