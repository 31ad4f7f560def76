//! Inputs and surface of a model file, for programs other than the twin. No modes are read.

use crate::load::first;
use rom::inputs::InputSpec;
use rom::model::{BlockData, BlockKind, ModelReader};
use rom::snapshots::NodeSet;
use std::path::Path;

/// Inputs and surface of a model.
#[derive(Debug)]
pub struct KnownModel {
    /// Its file's name without ending.
    pub name: String,
    /// First 16 bytes of the file's hash, as states and fields carry them.
    pub hash: [u8; 16],
    /// Its inputs in order.
    pub inputs: Vec<KnownInput>,
    node_count: usize,
    node_sets: Vec<NodeSet>,
    /// Nodes of the surface's triangles, three each.
    surface: Vec<u32>,
}

/// An input of a model.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownInput {
    /// Name and unit (`pressure_mpa`).
    pub key: String,
    /// Unit (`MPa`).
    pub unit: String,
    /// Smallest and largest training value; `None` if no regime was trained over it.
    pub range: Option<[f64; 2]>,
}

impl KnownModel {
    /// Reads what is needed of a model file.
    ///
    /// # Errors
    /// Why the file cannot be read, or is no model.
    pub fn read(path: &Path) -> Result<Self, String> {
        let mut reader = ModelReader::open_file(path).map_err(|error| error.to_string())?;
        let hash = first(&reader.hash());
        let entry = reader.blocks().iter().find(|entry| entry.kind == BlockKind::Surface).cloned();
        let blocks = reader.read_blocks(entry.as_slice()).map_err(|error| error.to_string())?;
        let surface = match blocks.into_iter().next() {
            Some((_, BlockData::U32(nodes))) => nodes,
            _ => Vec::new(),
        };
        let header = reader.header();
        if surface.len() % 3 != 0 || surface.iter().any(|node| *node as usize >= header.node_count) {
            return Err("its surface names nodes that it does not have".into());
        }
        Ok(Self {
            name: path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned()),
            hash,
            inputs: header.inputs.iter().map(KnownInput::of).collect(),
            node_count: header.node_count,
            node_sets: header.node_sets.clone(),
            surface,
        })
    }

    /// The corners of the surface's triangles, three each, as places in a field of this node set (none: of all nodes).
    /// None when the model has no surface or some of its nodes are not in the set. `O(nodes + triangles)`.
    pub fn corners(&self, node_set: Option<&str>) -> Option<Vec<u32>> {
        if self.surface.is_empty() {
            return None;
        }
        let Some(name) = node_set else { return Some(self.surface.clone()) };
        let set = self.node_sets.iter().find(|set| set.name == name)?;
        let mut places = vec![None; self.node_count];
        for (place, node) in (0..).zip(&set.nodes) {
            *places.get_mut(*node as usize)? = Some(place);
        }
        self.surface.iter().map(|node| *places.get(*node as usize)?).collect()
    }

    /// Nodes of a field of this node set (none: of all nodes); none when the model has no such set.
    pub fn nodes(&self, node_set: Option<&str>) -> Option<usize> {
        let Some(name) = node_set else { return Some(self.node_count) };
        Some(self.node_sets.iter().find(|set| set.name == name)?.nodes.len())
    }
}

impl KnownInput {
    fn of(spec: &InputSpec) -> Self {
        let range = Some(spec.range).filter(|range| range.iter().all(|end| end.is_finite()));
        Self { key: spec.key(), unit: spec.unit.clone(), range }
    }
}
