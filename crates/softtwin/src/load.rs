//! A model file in memory, with what pictures and the viewer ask of it.

use crate::files;
use anyhow::Result;
use rom::inputs::{GAP, PRESSURE};
use rom::model::{BlockKind, Model};
use rom::snapshots::Footprint;
use std::path::{Path, PathBuf};

/// A model and where it came from.
pub struct LoadedModel {
    /// Its file.
    pub path: PathBuf,
    pub model: Model,
    hash: [u8; 32],
}

impl LoadedModel {
    /// Reads a model file whole, every checksum verified.
    ///
    /// # Errors
    /// When the file cannot be read or is not a model of this version.
    pub fn read(path: &Path) -> Result<Self> {
        let (model, hash) = files::model_and_hash(path)?;
        Ok(Self { path: path.to_owned(), model, hash })
    }

    /// First half of the file's hash, as in the headers of its fields.
    pub fn hash16(&self) -> [u8; 16] {
        std::array::from_fn(|k| self.hash[k])
    }

    /// Name for people: that of the file.
    pub fn name(&self) -> String {
        self.path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned())
    }

    /// Undeformed node positions, if the model has them.
    pub fn undeformed_mm(&self) -> Option<Vec<[f32; 3]>> {
        let axis = |k| self.model.f32_block(BlockKind::Undeformed(k));
        let (x, y, z) = (axis(0)?, axis(1)?, axis(2)?);
        Some(x.iter().zip(y).zip(z).map(|((x, y), z)| [*x, *y, *z]).collect())
    }

    /// Extent of a plate below it, for pictures; the paper's where the model has no mesh.
    pub fn plate(&self) -> Footprint {
        self.undeformed_mm().and_then(|nodes| Footprint::plate_below(&nodes)).unwrap_or(Footprint::PLATE)
    }

    /// Facets of the surface, cavities included; empty when unknown.
    pub fn facets(&self) -> Vec<[u32; 3]> {
        Self::facets_of(&self.model)
    }

    /// [`Self::facets`] of a model.
    pub fn facets_of(model: &Model) -> Vec<[u32; 3]> {
        model.u32_block(BlockKind::Surface).unwrap_or(&[]).as_chunks::<3>().0.to_vec()
    }

    /// Trained pressures over all regimes, MPa.
    pub fn pressure_range_mpa(&self) -> [f64; 2] {
        self.range(PRESSURE).unwrap_or([0.0, 0.1])
    }

    /// Trained gaps, mm; the one gap twice when all samples shared it; none when there is no obstacle at all.
    pub fn gap_range_mm(&self) -> Option<[f64; 2]> {
        self.range(GAP)
    }

    fn range(&self, input: usize) -> Option<[f64; 2]> {
        Some(self.model.header.inputs[input].range).filter(|range| range[0].is_finite())
    }
}
