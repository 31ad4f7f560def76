//! What the undeformed mesh adds to a database: node positions, the skin for viewers, node sets.

use crate::error::{Diagnostic, FormatError};
use crate::mesh_file::{TET_FACES, TRI_FACETS, Tet10};
use crate::mesh_reader::read_mesh;
use rom::snapshots::NodeSet;
use std::collections::HashMap;
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
    let mesh = read_mesh(path)?;
    if mesh.points_mm.len() != nodes {
        let diagnostic =
            Diagnostic::new("points", format!("{nodes} as in the snapshots"), mesh.points_mm.len());
        return Err(FormatError::one(path, diagnostic));
    }
    let triangles = surface_of_tets(&mesh.tets);
    let node_sets = node_sets(&mesh.points_mm, &triangles);
    Ok(Body { points_mm: mesh.points_mm, triangles, node_sets })
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

/// The skin of a body of 10-node tetrahedra: the faces that only one of them has, each as four flat triangles over its
/// corners and mid-edge nodes, pointing outwards, in the order of the tetrahedra. `O(tets)`.
pub fn surface_of_tets(tets: &[Tet10]) -> Vec<[u32; 3]> {
    let corners = |tet: &Tet10, face: &[usize; 6]| {
        let mut key = [tet[face[0]], tet[face[1]], tet[face[2]]];
        key.sort_unstable();
        key
    };
    let mut owners: HashMap<[u32; 3], u32> = HashMap::with_capacity(tets.len() * 2);
    for tet in tets {
        for face in &TET_FACES {
            *owners.entry(corners(tet, face)).or_default() += 1;
        }
    }
    let mut skin = Vec::new();
    for tet in tets {
        for face in TET_FACES.iter().filter(|face| owners[&corners(tet, face)] == 1) {
            skin.extend(TRI_FACETS.map(|part| part.map(|i| tet[face[i]])));
        }
    }
    skin
}

/// Nodes on the lowest plane of the undeformed body: what meets the plate first.
pub fn bottom_nodes(points_mm: &[[f64; 3]]) -> Vec<u32> {
    let lowest = points_mm.iter().map(|p| p[1]).fold(f64::INFINITY, f64::min);
    // Meshers round coordinates; a micrometre is far below any feature of an actuator.
    (0..points_mm.len() as u32).filter(|i| points_mm[*i as usize][1] - lowest < 1e-3).collect()
}
