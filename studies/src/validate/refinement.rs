//! The same states of a shorter actuator on one family of finer and finer grids: what the element size costs.

use super::book::Book;
use fem::actuator::Actuator;
use fem::{Problem, Solver};
use softtwin::failure::{configuration, usage};
use softtwin::files::refusal;
use std::path::Path;
use std::sync::Arc;

const PART: &str = "refinement";

/// Pressure of the study (MPa).
const PRESSURE_MPA: f64 = 0.05;
/// Position of the plate, as a fraction of the path from the resting to the inflated tip.
const PLATE_FRACTION: f64 = 0.5;
/// How much sharper the plate's penalty is than the reference's, which is made for strokes of tens of millimetres: here the
/// stroke is a fraction of one, and what is studied is the solid's mesh.
const SHARPER: f64 = 10.0;
/// Longest edge of the coarsest mesh's boxes (mm): hardly more than one box between two faces of the actuator.
const SIZE_MM: f64 = 9.0;
/// Bounds on the last refinement's change (%): lowest point, volume, force.
const BOUNDS: [f64; 3] = [1.0, 0.5, 2.0];

/// Compared quantities of the refinement. None is a maximum over nodes, because nodes have other positions in other meshes.
const WATCHED: [&str; 3] = ["lowest point (mm)", "cavity volume (mm3)", "contact force (N)"];

struct Level {
    times: usize,
    figures: [f64; 3],
}

pub fn run(path: &Path, chambers: usize, times: &[usize], book: &mut Book) -> anyhow::Result<()> {
    let mut actuator = shortened(Actuator::read(path).map_err(refusal)?, chambers)?;
    actuator.contact.obstacle_penalty_mpa_per_mm *= SHARPER;
    actuator.contact.obstacle_smoothing_mm /= SHARPER;
    book.heading(&format!(
        "mesh refinement, chambers: {chambers}, {PRESSURE_MPA} MPa: coarser mesh against the finest"
    ))?;
    let mut gap_mm = None;
    let mut levels: Vec<Level> = Vec::new();
    // The finest first: it determines the plate's position for all.
    let mut times = times.to_vec();
    times.sort_unstable_by(|a, b| b.cmp(a));
    for times in times {
        let level = level(&actuator, times, &mut gap_mm, book)?;
        levels.push(level);
    }
    let Some((finest, coarser)) = levels.split_first() else { return Ok(()) };
    for (k, level) in coarser.iter().enumerate() {
        for (i, what) in WATCHED.iter().enumerate() {
            // Only the last step of the refinement has a bound; those before show the order.
            let bound = if k == 0 { BOUNDS[i] } else { 100.0 };
            let quantity = format!("{} against {} parts: {what}", level.times, finest.times);
            book.relative(PART, quantity, (level.figures[i], finest.figures[i]), bound)?;
        }
    }
    Ok(())
}

/// The actuator with fewer (or more) chambers; body and base keep their ends.
fn shortened(mut actuator: Actuator, chambers: usize) -> anyhow::Result<Actuator> {
    if chambers == 0 {
        return Err(usage("--chambers: expected at least 1, found 0"));
    }
    let parts = (&mut actuator.base, &mut actuator.body, &mut actuator.chambers);
    let (Some(base), Some(body), Some(row)) = parts else {
        return Err(usage("--actuator: expected base, body and chambers, found a shape of a mesh file"));
    };
    let less_mm = (row.count as f64 - chambers as f64) * row.pitch_mm;
    row.count = chambers;
    body.length_mm -= less_mm;
    base.length_mm -= less_mm;
    Ok(actuator)
}

fn level(actuator: &Actuator, times: usize, gap_mm: &mut Option<f64>, book: &Book) -> anyhow::Result<Level> {
    let mesh = actuator.grid_mesh(SIZE_MM, times).map_err(|list| usage(format!("--times: {list:?}")))?;
    let problem = Arc::new(Problem::new(mesh, actuator.problem_config()).map_err(configuration)?);
    let mut solver = Solver::new(Arc::clone(&problem))?;
    let (rest, _) = solver.gravity_equilibrium(actuator.loads.gravity_mm_s2)?;
    let (free, report) = solver.solve_to(&rest, &actuator.load(PRESSURE_MPA, None))?;
    let (low, high) = (solver.clearance_mm(&rest), solver.clearance_mm(&free));
    let gap = *gap_mm.get_or_insert(low + PLATE_FRACTION * (high - low));
    let (touching, _) = solver.solve_to(&free, &actuator.load(PRESSURE_MPA, Some(gap)))?;
    let output = solver.output(&free);
    let figures = [high, output.cavity_volume_mm3, solver.output(&touching).contact_force_n];
    book.remark(&format!(
        "{times} parts a box: {} nodes, {} elements, lowest point {:.4} mm, volume {:.2} mm3, force {:.5} N at gap {gap:.3} mm, {:.2} s a factorisation",
        problem.mesh().nodes_mm.len(),
        problem.mesh().tets.len(),
        figures[0],
        figures[1],
        figures[2],
        report.seconds / report.factorisations as f64
    ))?;
    Ok(Level { times, figures })
}
