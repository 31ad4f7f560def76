//! Consistent mass matrix of the elastomer.

use crate::algebra::Vec3;
use crate::element::tet10::PAIRS;
use crate::problem::Problem;
use formats::mesh_file::TET_EDGES;

/// Integral of the products of two shape functions over an element with straight edges, divided by its volume, times 420.
fn products() -> [[f64; 10]; 10] {
    let mut m = [[0.0; 10]; 10];
    for (i, row) in m.iter_mut().enumerate() {
        for (j, value) in row.iter_mut().enumerate() {
            *value = match (i < 4, j < 4) {
                (true, true) if i == j => 6.0,
                (true, true) => 1.0,
                (true, false) => corner_and_edge(i, j),
                (false, true) => corner_and_edge(j, i),
                (false, false) => {
                    let [a, b] = TET_EDGES[i - 4];
                    let shared = TET_EDGES[j - 4].iter().filter(|c| **c == a || **c == b).count();
                    [8.0, 16.0, 32.0][shared]
                }
            };
        }
    }
    m
}

fn corner_and_edge(corner: usize, edge: usize) -> f64 {
    if TET_EDGES[edge - 4].contains(&corner) { -4.0 } else { -6.0 }
}

/// Consistent mass in the pattern of the stiffness.
pub(crate) struct Mass {
    /// Lower triangle (t).
    pub(crate) values: Vec<f64>,
}

impl Mass {
    /// Assembles the mass of a problem.
    pub(crate) fn new(problem: &Problem) -> Self {
        let products = products();
        let mut values = vec![0.0; problem.pattern.stored()];
        for (e, (tet, geometry)) in problem.mesh.tets.iter().zip(&problem.tets).enumerate() {
            let mass_t = problem.elastomer(e).density_t_per_mm3 * geometry.volume_mm3();
            let free = tet.map(|n| problem.free[n as usize]);
            let pairs = (0..10).flat_map(|i| (0..=i).map(move |j| (i, j)));
            let ranks: &[u32; PAIRS] = &problem.tet_ranks[e];
            for ((i, j), rank) in pairs.zip(ranks) {
                let m = mass_t * products[i][j] / 420.0;
                let block = [[m, 0.0, 0.0], [0.0, m, 0.0], [0.0, 0.0, m]];
                problem.pattern.add(&mut values, free[i], free[j], *rank, &block);
            }
        }
        Self { values }
    }

    /// `M v` over the unknowns.
    pub(crate) fn times(&self, problem: &Problem, v: &[f64]) -> Vec<f64> {
        problem.pattern.multiply(&self.values, v)
    }
}

/// Scalar product.
pub(crate) fn product(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Values at the unknowns of a nodal vector.
pub(crate) fn gather(problem: &Problem, nodal: &[Vec3]) -> Vec<f64> {
    let mut out = vec![0.0; problem.pattern.unknowns()];
    for (v, free) in nodal.iter().zip(problem.free.iter()) {
        if let Some(place) = out.get_mut(3 * *free as usize..).and_then(|rest| rest.first_chunk_mut()) {
            *place = *v;
        }
    }
    out
}

/// Nodal vector of values at the unknowns; 0 at held nodes.
pub(crate) fn scatter(problem: &Problem, values: &[f64]) -> Vec<Vec3> {
    let nodal = |free: &u32| values.get(3 * *free as usize..).and_then(|rest| rest.first_chunk::<3>());
    problem.free.iter().map(|free| nodal(free).copied().unwrap_or_default()).collect()
}
