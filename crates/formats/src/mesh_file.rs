//! What a mesh file holds, whatever its format: nodes, 10-node tetrahedra, named surfaces.

use std::collections::BTreeMap;

/// A second-order tetrahedral mesh as read. Indices are 0-based and below the number of nodes; nothing else is checked.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshFile {
    /// Node positions, mm.
    pub points_mm: Vec<[f64; 3]>,
    /// Tetrahedra: four corners, then the mid-sides of 01, 12, 02, 03, 13, 23.
    pub tets: Vec<[u32; 10]>,
    /// Triangles of each named surface: three corners, then the mid-sides of 01, 12, 20.
    pub surfaces: BTreeMap<String, Vec<[u32; 6]>>,
}
