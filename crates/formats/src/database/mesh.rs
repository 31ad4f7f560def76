//! What the undeformed mesh adds to a database: node positions, the skin for viewers, node sets.

use crate::cells;
use crate::error::{Diagnostic, FormatError};
use crate::mesh_reader::read_blocks;
use rom::snapshots::NodeSet;
use std::path::Path;

/// The parts of a mesh a database remembers.
#[derive(Default)]
pub(crate) struct Body {
    pub(crate) points_mm: Vec<[f64; 3]>,
    pub(crate) triangles: Vec<[u32; 3]>,
    pub(crate) node_sets: Vec<NodeSet>,
}

/// Reads a mesh and checks it against the node count.
pub(crate) fn read(path: &Path, nodes: usize) -> Result<Body, FormatError> {
    let (points_mm, blocks) = read_blocks(path)?;
    if points_mm.len() != nodes {
        let diagnostic = Diagnostic::new("points", format!("{nodes} as in the snapshots"), points_mm.len());
        return Err(FormatError::one(path, diagnostic));
    }
    let triangles = cells::surface(&points_mm, &blocks);
    let node_sets = node_sets(&points_mm, &triangles);
    Ok(Body { points_mm, triangles, node_sets })
}

/// Named node sets every mesh has: its underside, which meets the plate, and its skin.
fn node_sets(points_mm: &[[f64; 3]], triangles: &[[u32; 3]]) -> Vec<NodeSet> {
    let mut skin: Vec<u32> = triangles.iter().flatten().copied().collect();
    skin.sort_unstable();
    skin.dedup();
    vec![
        NodeSet { name: "bottom".into(), nodes: bottom_nodes(points_mm) },
        NodeSet { name: "surface".into(), nodes: skin },
    ]
}

/// Nodes on the lowest plane of the undeformed body: what meets the plate first.
pub fn bottom_nodes(points_mm: &[[f64; 3]]) -> Vec<u32> {
    let lowest = points_mm.iter().map(|p| p[1]).fold(f64::INFINITY, f64::min);
    // Meshers round coordinates; a micrometre is far below any feature of an actuator.
    (0..points_mm.len() as u32).filter(|i| points_mm[*i as usize][1] - lowest < 1e-3).collect()
}
