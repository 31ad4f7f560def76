//! Node-by-node agreement on the commercial solver's mesh: its own published state, and states that an independent
//! implementation of the same formulation computed there.

use super::abaqus_arrays;
use super::agreement::{REFERENCE_FIELDS, compare};
use super::book::Book;
use anyhow::Context;
use fem::{GRAVITY_ALONG_MM_S2, GRAVITY_DOWN_MM_S2};
use fem::{Load, Obstacle, Problem, ProblemConfig, Solver, State};
use formats::npy;
use softtwin::failure::{configuration, usage};
use softtwin::files::refusal;
use std::path::Path;
use std::sync::Arc;

const PART: &str = "commercial";

/// Pressure of the published result (MPa).
const PUBLISHED_MPA: f64 = 0.014_352;
/// From the actuator's frame to that of the published result (mm).
const STEP_FRAME_MM: [f64; 3] = [-65.928_617, -7.036_239, 99.0];
/// Bounds on mean and largest distance (mm) and on the stress' median relative error (%) of the published state.
const PUBLISHED_BOUNDS: (f64, f64, f64) = (0.005, 0.02, 0.2);
/// Bound on the mean distance of a recomputed state (mm).
const MEAN_BOUND_MM: f64 = 0.02;
/// Bounds on a recomputed contact force: per cent, or N where that is more.
const FORCE_BOUND: (f64, f64) = (0.3, 0.001);

/// One case of the shared database.
struct Case {
    load: Load,
    force_n: f64,
}

pub fn run(shared: &Path, cases: &[usize], book: &mut Book) -> anyhow::Result<()> {
    let (reference, database) = (shared.join("reference"), shared.join("database"));
    if !reference.join("abaqus_mesh").is_dir() {
        return book
            .skip(format!("no {}: the commercial solver's mesh", reference.join("abaqus_mesh").display()));
    }
    let mesh = abaqus_arrays::read(&reference.join("abaqus_mesh")).map_err(configuration)?;
    book.heading(&format!("commercial solver, node by node on its {} nodes", mesh.nodes_mm.len()))?;
    let problem = Arc::new(Problem::new(mesh, ProblemConfig::default()).map_err(configuration)?);
    let mut solver = Solver::new(problem)?;
    let (rest, _) = solver.gravity_equilibrium(GRAVITY_DOWN_MM_S2)?;
    let state = published(&mut solver, &rest, &reference.join("abaqus_free_p0.014352.npy"), book)?;
    if !database.is_dir() {
        return book.skip(format!("no {}: states recomputed on that mesh", database.display()));
    }
    recomputed(&mut solver, vec![rest, state], &database, cases, book)
}

/// The commercial solver's own result.
fn published(solver: &mut Solver, rest: &State, file: &Path, book: &mut Book) -> anyhow::Result<State> {
    let load = Load { pressure_mpa: PUBLISHED_MPA, gravity_mm_s2: GRAVITY_DOWN_MM_S2, ..Load::default() };
    let (state, _) = solver.solve_to(rest, &load)?;
    let result = npy::read_f32(file).map_err(refusal)?;
    let agreement = compare(&solver.output(&state), &result.data, STEP_FRAME_MM)
        .with_context(|| format!("{} belongs to another mesh", file.display()))?;
    let (mean, max, stress) = PUBLISHED_BOUNDS;
    let at = |what: &str| format!("{PUBLISHED_MPA} MPa: {what}");
    book.absolute(PART, at("mean distance of nodes (mm)"), agreement.mean_mm, (mean, "mm"))?;
    book.absolute(PART, at("largest distance of nodes (mm)"), agreement.max_mm, (max, "mm"))?;
    let median = 100.0 * agreement.von_mises_median;
    book.absolute(PART, at("von Mises, median error (%)"), median, (stress, "%"))?;
    let both = (agreement.largest_mm, agreement.reference_largest_mm);
    book.relative(PART, at("largest displacement (mm)"), both, 0.01)?;
    Ok(state)
}

fn recomputed(
    solver: &mut Solver,
    mut solved: Vec<State>,
    database: &Path,
    cases: &[usize],
    book: &mut Book,
) -> anyhow::Result<()> {
    let table = database.join("cases.csv");
    let csv = std::fs::read_to_string(&table).with_context(|| format!("cannot read {}", table.display()))?;
    let snapshots = npy::read_f32(&database.join("snapshots.npy")).map_err(refusal)?.data;
    let entries = REFERENCE_FIELDS * solver.problem().mesh().nodes_mm.len();
    for &index in cases {
        let unknown = || usage(format!("--cases {index}: {} has no such case", table.display()));
        let case = case(&csv, index).ok_or_else(unknown)?;
        let snapshot = snapshots.get(index * entries..(index + 1) * entries).ok_or_else(unknown)?;
        let near = |s: &&State| distance(&s.load, &case.load);
        let start =
            solved.iter().min_by(|a, b| near(a).total_cmp(&near(b))).context("no state to start from")?;
        let (state, _) = solver.solve_to(start, &case.load)?;
        let output = solver.output(&state);
        let agreement = compare(&output, snapshot, [0.0; 3]).context("the database has another mesh")?;
        let gap = case.load.obstacle.gap_mm().map_or_else(|| "free".into(), |g| format!("gap {g:.3}"));
        let name = format!("case {index}, {:.6} MPa, {gap}", case.load.pressure_mpa);
        book.absolute(PART, format!("{name}: mean distance"), agreement.mean_mm, (MEAN_BOUND_MM, "mm"))?;
        if case.force_n > 0.0 {
            let bound = FORCE_BOUND.0.max(100.0 * FORCE_BOUND.1 / case.force_n);
            book.relative(PART, format!("{name}: force (N)"), (output.contact_force_n, case.force_n), bound)?;
        }
        solved.push(state);
    }
    Ok(())
}

fn case(csv: &str, index: usize) -> Option<Case> {
    let row: Vec<&str> = csv.lines().nth(index + 1)?.split(',').collect();
    let (regime, pressure_mpa, gap) = (row.get(1)?, row.get(3)?.parse().ok()?, row.get(4)?.parse().ok());
    let (obstacle, gravity_mm_s2) = match (*regime, gap) {
        ("gripper", Some(gap_mm)) => (Obstacle::Block { gap_mm }, GRAVITY_ALONG_MM_S2),
        (_, Some(gap_mm)) => (Obstacle::Plate { gap_mm }, GRAVITY_DOWN_MM_S2),
        _ => (Obstacle::None, GRAVITY_DOWN_MM_S2),
    };
    Some(Case {
        load: Load { pressure_mpa, obstacle, gravity_mm_s2, ..Load::default() },
        force_n: row.get(5)?.parse().ok()?,
    })
}

/// Distance of two loads, in which 50 mm of gap count as much as the whole pressure range.
fn distance(a: &Load, b: &Load) -> f64 {
    let attitude = if a.gravity_mm_s2 == b.gravity_mm_s2 { 0.0 } else { 10.0 };
    let gap = |l: &Load| l.obstacle.gap_mm().unwrap_or(60.0) / 50.0;
    attitude + (a.pressure_mpa - b.pressure_mpa).abs() / 0.09 + (gap(a) - gap(b)).abs()
}
