//! Cells of meshes by VTK's numbers: their names, their faces and the surface of a body.

use crate::error::Diagnostic;
use crate::mesh_file::{MeshFile, TET_FACES, TRI_FACETS};
use std::collections::HashMap;

/// Cells of one kind.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Block {
    /// VTK's number of the kind: 24 for 10-node tetrahedra, 25 for 20-node hexahedra, ...
    pub kind: u8,
    pub nodes_per_cell: usize,
    /// `cells x nodes_per_cell`.
    pub nodes: Vec<u32>,
}

impl Block {
    pub fn count(&self) -> usize {
        self.nodes.len() / self.nodes_per_cell.max(1)
    }

    /// Adds a cell of `kind` to its block among `blocks`.
    pub(crate) fn add(blocks: &mut Vec<Self>, kind: CellKind, nodes: impl IntoIterator<Item = u32>) {
        match blocks.iter_mut().find(|block| block.kind == kind.number) {
            Some(block) => block.nodes.extend(nodes),
            None => blocks.push(Self {
                kind: kind.number,
                nodes_per_cell: kind.nodes,
                nodes: nodes.into_iter().collect(),
            }),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CellKind {
    pub number: u8,
    pub nodes: usize,
    /// Shape in the plural (`tetrahedra`).
    pub shape: &'static str,
    /// True if it has a volume.
    pub is_solid: bool,
    pub meshio: &'static str,
}

const fn kind(
    number: u8,
    nodes: usize,
    shape: &'static str,
    is_solid: bool,
    meshio: &'static str,
) -> CellKind {
    CellKind { number, nodes, shape, is_solid, meshio }
}

/// Supported kinds: solids, then faces.
pub const KINDS: [CellKind; 12] = [
    kind(10, 4, "tetrahedra", true, "tetra"),
    kind(24, 10, "tetrahedra", true, "tetra10"),
    kind(12, 8, "hexahedra", true, "hexahedron"),
    kind(25, 20, "hexahedra", true, "hexahedron20"),
    kind(13, 6, "wedges", true, "wedge"),
    kind(26, 15, "wedges", true, "wedge15"),
    kind(14, 5, "pyramids", true, "pyramid"),
    kind(27, 13, "pyramids", true, "pyramid13"),
    kind(5, 3, "triangles", false, "triangle"),
    kind(22, 6, "triangles", false, "triangle6"),
    kind(9, 4, "quadrilaterals", false, "quad"),
    kind(23, 8, "quadrilaterals", false, "quad8"),
];

impl CellKind {
    /// Kind by VTK's number.
    pub fn of(number: usize) -> Option<Self> {
        KINDS.into_iter().find(|kind| usize::from(kind.number) == number)
    }

    /// Faces as corners, then mid-sides, with the normal out of the cell; of a face, itself.
    fn faces(self) -> Vec<Vec<usize>> {
        let corners = |faces: &[&[usize]]| -> Vec<Vec<usize>> {
            faces.iter().map(|face| face[..face.len() / 2].to_vec()).collect()
        };
        let all =
            |faces: &[&[usize]]| -> Vec<Vec<usize>> { faces.iter().map(|face| face.to_vec()).collect() };
        match self.number {
            10 => corners(&TET_FACES.each_ref().map(|face| face.as_slice())),
            24 => all(&TET_FACES.each_ref().map(|face| face.as_slice())),
            12 => corners(&HEXAHEDRON),
            25 => all(&HEXAHEDRON),
            13 => corners(&WEDGE),
            26 => all(&WEDGE),
            14 => corners(&PYRAMID),
            27 => all(&PYRAMID),
            _ => vec![(0..self.nodes).collect()],
        }
    }
}

const HEXAHEDRON: [&[usize]; 6] = [
    &[0, 3, 2, 1, 11, 10, 9, 8],
    &[4, 5, 6, 7, 12, 13, 14, 15],
    &[0, 1, 5, 4, 8, 17, 12, 16],
    &[1, 2, 6, 5, 9, 18, 13, 17],
    &[2, 3, 7, 6, 10, 19, 14, 18],
    &[3, 0, 4, 7, 11, 16, 15, 19],
];

const WEDGE: [&[usize]; 5] = [
    &[0, 2, 1, 8, 7, 6],
    &[3, 4, 5, 9, 10, 11],
    &[0, 1, 4, 3, 6, 13, 9, 12],
    &[1, 2, 5, 4, 7, 14, 10, 13],
    &[2, 0, 3, 5, 8, 12, 11, 14],
];

const PYRAMID: [&[usize]; 5] = [
    &[0, 3, 2, 1, 8, 7, 6, 5],
    &[0, 1, 4, 5, 10, 9],
    &[1, 2, 4, 6, 11, 10],
    &[2, 3, 4, 7, 12, 11],
    &[3, 0, 4, 8, 9, 12],
];

/// Flat triangles of a face by its number of nodes, with its orientation.
fn facets(nodes: usize) -> &'static [[usize; 3]] {
    match nodes {
        3 => &[[0, 1, 2]],
        4 => &[[0, 1, 2], [0, 2, 3]],
        6 => &TRI_FACETS,
        _ => &[[0, 4, 7], [4, 1, 5], [5, 2, 6], [6, 3, 7], [4, 5, 6], [4, 6, 7]],
    }
}

/// The surface of a body: the faces that only one of its cells has, as flat triangles over corners and mid-edge nodes,
/// pointing outwards, in the order of the cells; of a mesh without solids all of its faces. `O(cells)`.
///
/// # Panics
/// When a cell names a node beyond `points`.
pub fn surface(points: &[[f64; 3]], blocks: &[Block]) -> Vec<[u32; 3]> {
    let known = |block: &&Block| CellKind::of(block.kind.into()).is_some();
    let solid = |block: &&Block| CellKind::of(block.kind.into()).is_some_and(|kind| kind.is_solid);
    let has_solids = blocks.iter().any(|block| solid(&block));
    let used: Vec<&Block> = blocks.iter().filter(|b| if has_solids { solid(b) } else { known(b) }).collect();
    let mut owners: HashMap<[u32; 4], u32> = HashMap::new();
    for_faces(&used, |_, face| *owners.entry(key(face)).or_default() += 1);
    let mut skin = Vec::new();
    for_faces(&used, |cell, face| {
        if owners[&key(face)] != 1 {
            return;
        }
        // Tetrahedra are ordered alike everywhere; of other cells programs disagree about which way is up.
        let turned = has_solids && !matches!(cell.len(), 4 | 10) && points_inwards(points, cell, face);
        skin.extend(facets(face.len()).iter().map(|part| {
            let [a, b, c] = part.map(|i| face[i]);
            if turned { [a, c, b] } else { [a, b, c] }
        }));
    });
    skin
}

/// Calls `take` with every cell and each of its faces.
fn for_faces(blocks: &[&Block], mut take: impl FnMut(&[u32], &[u32])) {
    for block in blocks {
        let faces = CellKind::of(block.kind.into()).map_or_else(Vec::new, CellKind::faces);
        let mut nodes = Vec::new();
        for cell in block.nodes.chunks_exact(block.nodes_per_cell) {
            for face in &faces {
                nodes.clear();
                nodes.extend(face.iter().map(|i| cell[*i]));
                take(cell, &nodes);
            }
        }
    }
}

fn corners(face: &[u32]) -> &[u32] {
    &face[..if matches!(face.len(), 4 | 8) { 4 } else { 3 }]
}

/// Key of a face, equal for the two cells at it.
fn key(face: &[u32]) -> [u32; 4] {
    let mut key = [u32::MAX; 4];
    key.iter_mut().zip(corners(face)).for_each(|(to, from)| *to = *from);
    key.sort_unstable();
    key
}

fn points_inwards(points: &[[f64; 3]], cell: &[u32], face: &[u32]) -> bool {
    let mean = |nodes: &[u32]| -> [f64; 3] {
        let sum = |k: usize| nodes.iter().map(|n| points[*n as usize][k]).sum::<f64>();
        [0, 1, 2].map(|k| sum(k) / nodes.len() as f64)
    };
    let (centre, middle) = (mean(cell), mean(face));
    let corners = corners(face);
    let [a, b, c] = [0, 1, corners.len() - 1].map(|i| points[corners[i] as usize]);
    let (u, v) = ([0, 1, 2].map(|k| b[k] - a[k]), [0, 1, 2].map(|k| c[k] - a[k]));
    let normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    (0..3).map(|k| normal[k] * (middle[k] - centre[k])).sum::<f64>() < 0.0
}

impl MeshFile {
    /// Mesh of the solids among `blocks`; points, lines and faces are ignored.
    ///
    /// # Errors
    /// Solids other than 10-node tetrahedra, or none.
    pub fn of_solids(points_mm: Vec<[f64; 3]>, blocks: &[Block]) -> Result<Self, Diagnostic> {
        let is_solid = |block: &&Block| CellKind::of(block.kind.into()).is_some_and(|kind| kind.is_solid);
        let solids: Vec<&Block> = blocks.iter().filter(is_solid).collect();
        let [Block { kind: 24, nodes, .. }] = solids.as_slice() else {
            let count = |block: &&Block| format!("{} of type {}", block.count(), block.kind);
            let found = solids.iter().map(count).collect::<Vec<_>>().join(", ");
            let found = if found.is_empty() { "no solids".to_owned() } else { found };
            return Err(Diagnostic::new("cells", "10-node tetrahedra only (VTK's type 24, C3D10)", found));
        };
        Ok(Self { points_mm, tets: nodes.as_chunks::<10>().0.to_vec(), ..Self::default() })
    }
}
