//! Node-by-node agreement with the commercial result and with recomputed states, on the commercial solver's mesh.
//!
//! ```text
//! cargo run --release -p softtwin-fem --example validate                   the published state
//! cargo run --release -p softtwin-fem --example validate -- 28 34 70 124   and these cases of the shared database
//! ```
//! Needs `../shared/reference` and `../shared/database`, which are not part of the project; where they are absent it
//! says so and checks nothing. Ends with 1 when a state misses its bound.

use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;

use formats::npy;
use softtwin_fem::config::{GRAVITY_ALONG_MM_S2, GRAVITY_DOWN_MM_S2};
use softtwin_fem::mesh::abaqus_arrays;
use softtwin_fem::validate::{Agreement, REFERENCE_FIELDS, compare};
use softtwin_fem::{Load, Obstacle, Problem, ProblemConfig, Report, Solver, State};

type Failure = Box<dyn std::error::Error>;

/// Pressure of the published commercial result (MPa).
const PUBLISHED_MPA: f64 = 0.014_352;

/// From the actuator's frame to that of the published result (mm).
const STEP_FRAME_MM: [f64; 3] = [-65.928_617, -7.036_239, 99.0];

/// Bounds on mean and largest distance (mm) and on the stress' median relative error of the published state.
const PUBLISHED_BOUNDS: (f64, f64, f64) = (0.005, 0.02, 0.002);

/// Bound on the mean distance of a recomputed state (mm).
const MEAN_BOUND_MM: f64 = 0.02;

/// One case of the shared database.
struct Case {
    load: Load,
    force_n: f64,
}

fn case(csv: &str, index: usize) -> Option<Case> {
    let row: Vec<&str> = csv.lines().nth(index + 1)?.split(',').collect();
    let (regime, pressure_mpa, gap) = (row.get(1)?, row.get(3)?.parse().ok()?, row.get(4)?.parse().ok());
    let (obstacle, gravity_mm_s2) = match (*regime, gap) {
        ("gripper", Some(gap_mm)) => (Obstacle::Block { gap_mm }, GRAVITY_ALONG_MM_S2),
        (_, Some(gap_mm)) => (Obstacle::Plate { gap_mm }, GRAVITY_DOWN_MM_S2),
        _ => (Obstacle::None, GRAVITY_DOWN_MM_S2),
    };
    Some(Case { load: Load { pressure_mpa, obstacle, gravity_mm_s2 }, force_n: row.get(5)?.parse().ok()? })
}

fn print(name: &str, load: &Load, a: &Agreement, force: (f64, f64), report: &Report) {
    let gap = load.obstacle.gap_mm().map_or_else(|| "free".to_owned(), |g| format!("{g:.3}"));
    println!(
        "{name:>9} {:>9.6} {gap:>7} {:>9.5} {:>9.5} {:>9.4} {:>9.4} {:>9.2e} {:>8.5} {:>8.5} {:>5} {:>7.1}",
        load.pressure_mpa,
        a.mean_mm,
        a.max_mm,
        a.largest_mm,
        a.reference_largest_mm,
        a.von_mises_median,
        force.0,
        force.1,
        report.factorisations,
        report.seconds
    );
}

/// Distance of two loads, in which a millimetre of gap counts as a fiftieth of the pressure range.
fn distance(a: &Load, b: &Load) -> f64 {
    let attitude = if a.gravity_mm_s2 == b.gravity_mm_s2 { 0.0 } else { 10.0 };
    let gap = |l: &Load| l.obstacle.gap_mm().unwrap_or(60.0) / 50.0;
    attitude + (a.pressure_mpa - b.pressure_mpa).abs() / 0.09 + (gap(a) - gap(b)).abs()
}

fn run(reference: &Path, database: &Path, cases: &[usize]) -> Result<bool, Failure> {
    let mesh = abaqus_arrays::read(&reference.join("abaqus_mesh"))?;
    let entries = REFERENCE_FIELDS * mesh.nodes_mm.len();
    let problem = Arc::new(Problem::new(mesh, ProblemConfig::default())?);
    let mut solver = Solver::new(problem)?;
    let (rest, report) = solver.rest(GRAVITY_DOWN_MM_S2)?;
    let sag = rest.displacement_mm.iter().map(|u| -u[1]).fold(0.0, f64::max);
    println!("sag at rest {sag:.3} mm ({} factorisations, {:.1} s)", report.factorisations, report.seconds);
    println!(
        "{:>9} {:>9} {:>7} {:>9} {:>9} {:>9} {:>9} {:>9} {:>8} {:>8} {:>5} {:>7}",
        "case",
        "P/MPa",
        "gap/mm",
        "mean/mm",
        "max/mm",
        "|U|/mm",
        "ref",
        "S median",
        "F/N",
        "ref",
        "fact",
        "s"
    );
    let load = Load { pressure_mpa: PUBLISHED_MPA, gravity_mm_s2: GRAVITY_DOWN_MM_S2, ..Load::default() };
    let (state, report) = solver.reach(&rest, &load)?;
    let published = npy::read_f32(&reference.join("abaqus_free_p0.014352.npy"))?;
    let output = solver.output(&state);
    let a =
        compare(&output, &published.data, STEP_FRAME_MM).ok_or("the published result has another mesh")?;
    print("published", &load, &a, (0.0, 0.0), &report);
    let (mean, max, stress) = PUBLISHED_BOUNDS;
    let mut good = a.mean_mm <= mean && a.max_mm <= max && a.von_mises_median <= stress;
    if cases.is_empty() {
        return Ok(good);
    }
    let csv = std::fs::read_to_string(database.join("cases.csv"))?;
    let snapshots = npy::read_f32(&database.join("snapshots.npy"))?.data;
    let mut solved: Vec<State> = vec![rest, state];
    for &index in cases {
        let case = case(&csv, index).ok_or_else(|| format!("case {index} is not in cases.csv"))?;
        let nearest = solved
            .iter()
            .min_by(|a, b| distance(&a.load, &case.load).total_cmp(&distance(&b.load, &case.load)))
            .ok_or("no state to start from")?;
        let (state, report) = solver.reach(nearest, &case.load)?;
        let output = solver.output(&state);
        let snapshot = snapshots.get(index * entries..(index + 1) * entries).ok_or("snapshots end early")?;
        let a = compare(&output, snapshot, [0.0; 3]).ok_or("the database has another mesh")?;
        print(&index.to_string(), &case.load, &a, (output.contact_force_n, case.force_n), &report);
        let off = (output.contact_force_n - case.force_n).abs();
        good &= a.mean_mm <= MEAN_BOUND_MM && off <= (0.003 * case.force_n).max(0.001);
        solved.push(state);
    }
    Ok(good)
}

fn main() -> ExitCode {
    let (reference, database) = (Path::new("../shared/reference"), Path::new("../shared/database"));
    if !reference.join("abaqus_mesh").is_dir() || !database.is_dir() {
        println!("skipped: ../shared/reference/abaqus_mesh or ../shared/database is absent");
        return ExitCode::SUCCESS;
    }
    let cases: Result<Vec<usize>, _> = std::env::args().skip(1).map(|a| a.parse()).collect();
    let outcome = cases.map_err(Failure::from).and_then(|cases| run(reference, database, &cases));
    match outcome {
        Ok(true) => {
            println!("within the bounds");
            ExitCode::SUCCESS
        }
        Ok(false) => {
            println!("a state misses its bound");
            ExitCode::FAILURE
        }
        Err(error) => {
            println!("failed: {error}");
            ExitCode::FAILURE
        }
    }
}
