//! Models from files: which blocks a selection needs, and which shapes the body can have.

use crate::body::{MAX_STRETCH, RegimeShapes, ShapeLimits};
use crate::model::{BlockEntry, BlockKind, MAX_MODEL_BYTES, Model, ModelFileError, ModelReader, Selection};
use crate::observable::Observables;
use crate::probe::{MeshPoint, affine_coordinate};
use crate::snapshots::FieldKind;
use std::fs::File;
use std::io::{Read, Seek};
use std::path::Path;
use std::sync::Arc;

/// Edges of the surface that are followed.
const EDGES: usize = 64;

impl Model {
    /// The whole model from a file, every checksum verified, and the file's hash, whose first half states and fields carry.
    ///
    /// # Errors
    /// I/O errors; what is no regular file or too long for a model; a damaged model.
    pub fn read(path: impl AsRef<Path>) -> Result<(Self, [u8; 32]), ModelFileError> {
        let mut bytes = Vec::new();
        // A file that grows while it is read ends at the limit too.
        model_file(path.as_ref())?.take(MAX_MODEL_BYTES).read_to_end(&mut bytes)?;
        let mut reader = ModelReader::of_bytes(&bytes)?;
        Ok((reader.load(&Selection::default())?, reader.hash()))
    }

    /// The whole model from bytes, every checksum verified.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, ModelFileError> {
        ModelReader::of_bytes(bytes)?.load(&Selection::default())
    }
}

/// Opens a model file. It is asked what it is first, because opening a pipe would wait for its writer.
fn model_file(path: &Path) -> Result<File, ModelFileError> {
    let metadata = path.metadata()?;
    match metadata.len() {
        _ if !metadata.is_file() => Err(ModelFileError::NoFile),
        found if found > MAX_MODEL_BYTES => Err(ModelFileError::TooLarge { found }),
        _ => Ok(File::open(path)?),
    }
}

impl ModelReader<File> {
    /// Opens a model file and reads its header; blocks are read as they are asked for.
    ///
    /// # Errors
    /// As [`Model::read`]; blocks are checked when they are read.
    pub fn open_file(path: &Path) -> Result<Self, ModelFileError> {
        Self::open(model_file(path)?)
    }
}

impl<R: Read + Seek> ModelReader<R> {
    /// Shapes that the body can have ([`ModelHeader::body`]), whatever part of the model is loaded: the blocks that say so are read, and
    /// dropped again.
    pub fn body(&mut self) -> Result<Option<Arc<ShapeLimits>>, ModelFileError> {
        let header = self.header().clone();
        let is_coordinate = |field: u32| {
            let field = header.fields.get(field as usize);
            field.is_some_and(|field| matches!(field.spec.kind, FieldKind::Coordinate(_)))
        };
        let needed = |block: &&BlockEntry| match block.kind {
            BlockKind::Mean { field, .. } | BlockKind::Modes { field, .. } => is_coordinate(field),
            BlockKind::Undeformed(_) | BlockKind::Surface | BlockKind::Observables => true,
            _ => false,
        };
        let entries: Vec<BlockEntry> = self.blocks().iter().filter(needed).cloned().collect();
        if !entries.iter().any(|block| block.kind == BlockKind::Surface) {
            return Ok(None);
        }
        let blocks = self.read_blocks(&entries)?;
        Ok(body_of(&Model { header, blocks }).map(Arc::new))
    }

    /// Loads what a selection needs: its fields (and the coordinates a derived magnitude needs), undeformed mesh,
    /// surface. Nodes are picked when the predictor is made.
    pub fn load(&mut self, selection: &Selection) -> Result<Model, ModelFileError> {
        let header = self.header().clone();
        let mut fields = header.resolve_fields(selection.fields.as_deref())?;
        header.resolve_nodes(&selection.nodes)?;
        let derived: Vec<usize> =
            fields.iter().filter_map(|f| header.fields[*f].magnitude_of).flatten().collect();
        fields.extend(derived);
        let needed = |kind: &BlockKind| match kind {
            BlockKind::Mean { field, .. }
            | BlockKind::Modes { field, .. }
            | BlockKind::HalfWidth { field } => fields.contains(&(*field as usize)),
            BlockKind::Undeformed(_)
            | BlockKind::UndeformedBy { .. }
            | BlockKind::Surface
            | BlockKind::Observables
            | BlockKind::Inertia
            | BlockKind::Memory => true,
            // In the header since the file was opened.
            BlockKind::Difference | BlockKind::Limit | BlockKind::Learned => false,
        };
        let entries: Vec<BlockEntry> = self.blocks().iter().filter(|b| needed(&b.kind)).cloned().collect();
        let blocks = self.read_blocks(&entries)?;
        let mut model = Model { header, blocks };
        // A selection with all coordinates has read what the shapes need; the blocks are not read twice.
        model.header.body = match body_of(&model) {
            Some(body) => Some(Arc::new(body)),
            None => self.body()?,
        };
        Ok(model)
    }
}

/// Edges of a model with its undeformed mesh, surface and coordinates loaded, and its volumes; `None` without one of these.
fn body_of(model: &Model) -> Option<ShapeLimits> {
    let mesh = model.undeformed_mm()?;
    let coordinate =
        |values: &[f32], node: u32| values.get(node as usize).copied().map_or(f64::NAN, f64::from);
    let place = |node: u32| mesh.map(|values| coordinate(values, node));
    let length = |[a, b]: [u32; 2]| {
        let (a, b) = (place(a), place(b));
        a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
    };
    let triangles = model.u32_block(BlockKind::Surface)?.as_chunks::<3>().0;
    let stretch = model.header.limit.as_ref().map_or(MAX_STRETCH, |limit| limit.stretch);
    let every = triangles.len().div_ceil(EDGES).max(1);
    let longest = |[a, b, c]: &[u32; 3]| {
        let edges = [[*a, *b], [*b, *c], [*c, *a]].map(|edge| (edge, length(edge)));
        edges.into_iter().max_by(|(_, a), (_, b)| a.total_cmp(b)).filter(|(_, length)| *length > 0.0)
    };
    let edges: Vec<([u32; 2], f64)> = triangles.iter().step_by(every).filter_map(longest).collect();
    // Observables that do not fit the model are refused where they are used.
    let observables = Observables::of(model).unwrap_or_default();
    let mut regimes = Vec::new();
    for regime in &model.header.regimes {
        let along = |([a, b], _): &([u32; 2], f64)| {
            let along = MeshPoint { weights: vec![(*b, 1.0), (*a, -1.0)] };
            let of_axis = |axis| affine_coordinate(model, regime, &along, axis).ok();
            Some([of_axis(0)?, of_axis(1)?, of_axis(2)?])
        };
        let edges = edges.iter().map(along).collect::<Option<Vec<_>>>()?;
        regimes.push(RegimeShapes {
            kind: regime.kind,
            edges,
            volumes: observables.volumes(regime.kind).to_vec(),
        });
    }
    let longest_mm = edges.iter().map(|(_, length)| stretch * length).collect();
    Some(ShapeLimits { regimes, longest_mm, stretch })
}
