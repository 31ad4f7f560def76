//! Small meshes made in code: boxes of second-order tetrahedra, with any face as a named surface.

use std::collections::HashMap;

use super::Mesh;
use formats::mesh_file::{TET_EDGES, TRI_EDGES, Tet10, Tri6};

/// Corner paths of the six tetrahedra a cube is split into (Kuhn's triangulation).
const PATHS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];

/// Collects nodes and elements; nodes at the same place are merged.
#[derive(Default)]
pub struct Builder {
    pub mesh: Mesh,
    index: HashMap<[i64; 3], u32>,
}

impl Builder {
    pub fn node(&mut self, p: [f64; 3]) -> u32 {
        let key = p.map(|v| (v * 1.0e6).round() as i64);
        *self.index.entry(key).or_insert_with(|| {
            self.mesh.nodes_mm.push(p);
            u32::try_from(self.mesh.nodes_mm.len() - 1).unwrap()
        })
    }

    fn middle(&mut self, a: u32, b: u32) -> u32 {
        let (a, b) = (self.mesh.nodes_mm[a as usize], self.mesh.nodes_mm[b as usize]);
        self.node(std::array::from_fn(|i| 0.5 * (a[i] + b[i])))
    }

    fn tet(&mut self, mut corners: [u32; 4]) {
        let x = corners.map(|n| self.mesh.nodes_mm[n as usize]);
        let edge = |k: usize| -> [f64; 3] { std::array::from_fn(|i| x[k][i] - x[0][i]) };
        let (a, b, c) = (edge(1), edge(2), edge(3));
        let det = a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
            + a[2] * (b[0] * c[1] - b[1] * c[0]);
        if det < 0.0 {
            corners.swap(2, 3);
        }
        let mut tet: Tet10 = [0; 10];
        tet[..4].copy_from_slice(&corners);
        for (m, [i, j]) in TET_EDGES.into_iter().enumerate() {
            tet[4 + m] = self.middle(corners[i], corners[j]);
        }
        self.mesh.tets.push(tet);
    }

    /// A box from `low` to `high` in `cells` cubes along each axis; cells for which `keep` is false are left out.
    pub fn cells(
        &mut self,
        low: [f64; 3],
        high: [f64; 3],
        cells: [usize; 3],
        keep: impl Fn([usize; 3]) -> bool,
    ) {
        let at = |c: [usize; 3]| -> [f64; 3] {
            std::array::from_fn(|i| low[i] + (high[i] - low[i]) * c[i] as f64 / cells[i] as f64)
        };
        for i in 0..cells[0] {
            for j in 0..cells[1] {
                for k in 0..cells[2] {
                    if !keep([i, j, k]) {
                        continue;
                    }
                    for path in PATHS {
                        let mut c = [i, j, k];
                        let mut corners = [self.node(at(c)); 4];
                        for (step, axis) in path.into_iter().enumerate() {
                            c[axis] += 1;
                            corners[step + 1] = self.node(at(c));
                        }
                        self.tet(corners);
                    }
                }
            }
        }
    }

    pub fn solid(&mut self, low: [f64; 3], high: [f64; 3], cells: [usize; 3]) {
        self.cells(low, high, cells, |_| true);
    }

    /// Boundary faces (of exactly one tetrahedron) all of whose corners satisfy `on`.
    pub fn faces(&mut self, on: impl Fn([f64; 3]) -> bool) -> Vec<Tri6> {
        let mut count: HashMap<[u32; 3], (u32, [u32; 3])> = HashMap::new();
        for t in &self.mesh.tets {
            for face in [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]] {
                let face = face.map(|k| t[k]);
                let mut key = face;
                key.sort_unstable();
                count.entry(key).or_insert((0, face)).0 += 1;
            }
        }
        let mut found: Vec<[u32; 3]> = count.values().filter(|(n, _)| *n == 1).map(|(_, f)| *f).collect();
        found.retain(|f| f.iter().all(|n| on(self.mesh.nodes_mm[*n as usize])));
        found.sort_unstable();
        found.into_iter().map(|f| self.tri(f)).collect()
    }

    pub fn tri(&mut self, c: [u32; 3]) -> Tri6 {
        let mut t = [c[0], c[1], c[2], 0, 0, 0];
        for (m, [i, j]) in TRI_EDGES.into_iter().enumerate() {
            t[3 + m] = self.middle(c[i], c[j]);
        }
        t
    }

    pub fn nodes_where(&self, on: impl Fn([f64; 3]) -> bool) -> Vec<u32> {
        let nodes = self.mesh.nodes_mm.iter().enumerate();
        nodes.filter(|(_, p)| on(**p)).map(|(n, _)| u32::try_from(n).unwrap()).collect()
    }
}

pub fn close(a: f64, b: f64, relative: f64) -> bool {
    (a - b).abs() <= relative * b.abs()
}
