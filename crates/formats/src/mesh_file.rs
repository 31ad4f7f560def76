//! Content of a mesh file in any format: nodes, 10-node tetrahedra, named surfaces; order of the nodes.

use std::collections::BTreeMap;

/// 10-node tetrahedron: four corners, then the mid-sides of 01, 12, 02, 03, 13 and 23.
pub type Tet10 = [u32; 10];

/// 6-node triangle: three corners, then the mid-sides of 01, 12 and 20.
pub type Tri6 = [u32; 6];

/// Corners of the edges with the mid-side nodes 4 to 9 of a [`Tet10`].
pub const TET_EDGES: [[usize; 2]; 6] = [[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]];

/// Corners of the edges with the mid-side nodes 3 to 5 of a [`Tri6`].
pub const TRI_EDGES: [[usize; 2]; 3] = [[0, 1], [1, 2], [2, 0]];

/// Faces of a [`Tet10`] as [`Tri6`], with the normal out of the tetrahedron.
pub const TET_FACES: [[usize; 6]; 4] =
    [[0, 2, 1, 6, 5, 4], [0, 1, 3, 4, 8, 7], [1, 2, 3, 5, 9, 8], [0, 3, 2, 7, 9, 6]];

/// Four flat triangles between the nodes of a [`Tri6`], with its orientation.
pub const TRI_FACETS: [[usize; 3]; 4] = [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]];

/// Second-order tetrahedral mesh. Indices are 0-based and below the number of nodes; nothing else is checked.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshFile {
    /// Node positions, mm.
    pub points_mm: Vec<[f64; 3]>,
    pub tets: Vec<Tet10>,
    /// Triangles of each named surface.
    pub surfaces: BTreeMap<String, Vec<Tri6>>,
    /// Tetrahedra of each named volume, by position in `tets`.
    pub volumes: BTreeMap<String, Vec<u32>>,
}
