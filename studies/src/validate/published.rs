//! Figures of the paper and of its published result, recomputed on the actuator's own mesh.

use super::book::Book;
use fem::actuator::Actuator;
use fem::{Solver, State};
use softtwin::files;
use std::path::Path;
use std::sync::Arc;

const PART: &str = "published";

/// Sag of the tip at rest (mm), bound in per cent.
const SAG: (f64, f64) = (27.6, 2.0);
/// Published commercial state: pressure (MPa), its largest displacement (mm), bound in per cent.
const FREE: (f64, f64, f64) = (0.014_352, 43.0243, 0.6);
/// Gap (mm) first touched at this pressure (MPa), bound in per cent.
const ONSET: (f64, f64, f64) = (40.0, 0.01352, 5.0);
/// Contact forces: pressure (MPa), gap (mm), force (N).
const FORCES: [(f64, f64, f64); 6] = [
    (0.032_257, 38.582_848, 0.113),
    (0.035_154, 35.7634, 0.146),
    (0.070_469, 29.744_473, 0.544),
    (0.078_165, 31.444_19, 0.628),
    (0.092, 8.0, 0.964),
    (0.1, 55.0, 0.864),
];
/// Grip: pressure (MPa), gap (mm), force of a finger (N).
const GRIP: (f64, f64, f64) = (0.079, 20.0, 0.58);
/// Bound of all forces in per cent.
const FORCE_BOUND: f64 = 2.0;
/// Secant steps towards the onset; the clearance is nearly linear in the pressure there.
const ONSET_STEPS: usize = 4;

pub fn run(actuator: &Path, gripper: &Path, book: &mut Book) -> anyhow::Result<()> {
    let (actuator, problem) = files::actuator(actuator)?;
    book.heading(&format!("published figures, own mesh of {} nodes", problem.mesh().nodes_mm.len()))?;
    let mut solver = Solver::new(Arc::clone(&problem))?;
    let (rest, _) = solver.gravity_equilibrium(actuator.loads.gravity_mm_s2)?;
    let sag = solver.clearance_mm(&rest);
    book.relative(PART, "sag at rest (mm)".into(), (sag, SAG.0), SAG.1)?;
    let (pressure, expected, bound) = FREE;
    let (free, _) = solver.solve_to(&rest, &actuator.load(pressure, None))?;
    let displacement = solver.output(&free).displacement_mm.into_iter().fold(0.0, f64::max);
    let quantity = format!("largest displacement at {pressure} MPa (mm)");
    book.relative(PART, quantity, (displacement, expected), bound)?;
    let (gap, expected, bound) = ONSET;
    let found = onset(&mut solver, &actuator, [&rest, &free], gap)?;
    book.relative(PART, format!("onset pressure at gap {gap} mm (MPa)"), (found, expected), bound)?;
    forces(&mut solver, &actuator, free, book)?;
    grip(gripper, book)
}

/// Pressure at which an obstacle at `gap_mm` just clears the free state, by the secant rule.
fn onset(
    solver: &mut Solver,
    actuator: &Actuator,
    [low, high]: [&State; 2],
    gap_mm: f64,
) -> anyhow::Result<f64> {
    let clear = |solver: &Solver, state: &State| solver.clearance_mm(state) - gap_mm;
    let mut before = (low.load.pressure_mpa, clear(solver, low));
    let mut now = (high.load.pressure_mpa, clear(solver, high));
    let mut state = high.clone();
    for _ in 0..ONSET_STEPS {
        let next = now.0 - now.1 * (now.0 - before.0) / (now.1 - before.1);
        if (next - now.0).abs() < 1.0e-7 {
            break;
        }
        (state, _) = solver.solve_to(&state, &actuator.load(next, None))?;
        before = now;
        now = (next, clear(solver, &state));
    }
    Ok(now.0)
}

fn forces(solver: &mut Solver, actuator: &Actuator, from: State, book: &mut Book) -> anyhow::Result<()> {
    let mut state = from;
    for (pressure, gap, expected) in FORCES {
        (state, _) = solver.solve_to(&state, &actuator.load(pressure, Some(gap)))?;
        let force = solver.output(&state).contact_force_n;
        let quantity = format!("contact force at {pressure} MPa, gap {gap} mm (N)");
        book.relative(PART, quantity, (force, expected), FORCE_BOUND)?;
    }
    Ok(())
}

fn grip(gripper: &Path, book: &mut Book) -> anyhow::Result<()> {
    let (actuator, problem) = files::actuator(gripper)?;
    let mut solver = Solver::new(problem)?;
    let (rest, _) = solver.gravity_equilibrium(actuator.loads.gravity_mm_s2)?;
    let (pressure, gap, expected) = GRIP;
    let (state, _) = solver.solve_to(&rest, &actuator.load(pressure, Some(gap)))?;
    let force = solver.output(&state).contact_force_n;
    book.relative(PART, format!("gripper's force at {pressure} MPa (N)"), (force, expected), FORCE_BOUND)
}
