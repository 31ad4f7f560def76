//! A model over some of its nodes.

use super::header::{BlockData, BlockKind, Model};
use super::selection::{ModelError, Nodes};
use crate::snapshots::NodeSet;

impl Model {
    /// The model over these nodes, in this order, for programs that show a part of it, such as its surface. Facets and node sets are kept
    /// where all of their nodes are; observables, which may need the other nodes, are not. Coefficients, force and half-widths are those of
    /// the whole model; fields are rounded once more, by at most half a step of their mode. Cost `O(nodes modes)`.
    ///
    /// # Errors
    /// [`ModelError::NodeOutOfRange`]; [`ModelError::Inconsistent`] for a block of another length.
    pub fn at_nodes(&self, nodes: &[u32]) -> Result<Self, ModelError> {
        self.header.resolve_nodes(&Nodes::List(nodes.to_vec()))?;
        let whole = self.header.node_count;
        let mut place = vec![None; whole];
        for (index, node) in (0..).zip(nodes) {
            place[*node as usize] = Some(index);
        }
        let place = |node: &u32| place.get(*node as usize).copied().flatten();
        let mut header = self.header.clone();
        header.node_count = nodes.len();
        header.node_sets = header
            .node_sets
            .iter()
            .filter_map(|set| {
                let nodes = set.nodes.iter().map(place).collect::<Option<Vec<u32>>>()?;
                Some(NodeSet { nodes, ..set.clone() })
            })
            .collect();
        header.body = None;
        let mut blocks = Vec::new();
        for (kind, data) in &self.blocks {
            let data = match data {
                _ if *kind == BlockKind::Observables => continue,
                BlockData::Modes(modes) => BlockData::Modes(modes.at_nodes(nodes)),
                BlockData::U32(corners) if *kind == BlockKind::Surface => {
                    let facets = corners.as_chunks::<3>().0.iter();
                    let kept = facets.filter_map(|[a, b, c]| Some([place(a)?, place(b)?, place(c)?]));
                    BlockData::U32(kept.flatten().collect())
                }
                BlockData::F32(values) if values.len() == whole => {
                    BlockData::F32(nodes.iter().map(|node| values[*node as usize]).collect())
                }
                BlockData::F32(values) => {
                    let found = values.len();
                    return Err(ModelError::Inconsistent(format!(
                        "{kind:?} has {found} values for {whole} nodes"
                    )));
                }
                BlockData::U32(_) | BlockData::Record(_) => data.clone(),
            };
            blocks.push((*kind, data));
        }
        Ok(Self { header, blocks })
    }
}
