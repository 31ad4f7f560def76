//! Single element of elastomer under its own weight, held at one face: the smallest problem on plain arrays.

use fem::{GRAVITY_DOWN_MM_S2, Mesh, Problem, ProblemConfig, Solver};
use formats::mesh_file::TET_EDGES;
use std::sync::Arc;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let corners = [[0.0, 0.0, 0.0], [30.0, 0.0, 0.0], [0.0, 10.0, 0.0], [0.0, 0.0, 10.0]];
    let middle = |[a, b]: [usize; 2]| [0, 1, 2].map(|k| 0.5 * (corners[a][k] + corners[b][k]));
    let mesh = Mesh {
        nodes_mm: corners.into_iter().chain(TET_EDGES.map(middle)).collect(),
        tets: vec![[0, 1, 2, 3, 4, 5, 6, 7, 8, 9]],
        fixed_nodes: vec![0, 2, 3, 6, 7, 9],
        ..Mesh::default()
    };
    let mut solver = Solver::new(Arc::new(Problem::new(mesh, ProblemConfig::default())?))?;
    let (state, report) = solver.gravity_equilibrium(GRAVITY_DOWN_MM_S2)?;
    println!("tip moves by {:?} mm, {} factorisations", state.displacement_mm[1], report.factorisations);
    Ok(())
}
