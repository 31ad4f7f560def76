//! The whole actuator on its own mesh and on a finer one: how far the reference mesh itself is off.
//!
//! Penalties are per area, so that they are the same on both. A state of the finer mesh starts from the coarser one's, interpolated.

use super::book::Book;
use fem::{Load, Locator, Output, Problem, SolveReport, Solver, State};
use serde::Serialize;
use softtwin::failure::usage;
use softtwin::files;
use std::path::Path;
use std::sync::Arc;

/// Pressure (MPa) and gap (mm; `None`: free) of the states: the paper's A to D, and E beyond the training range.
const STATES: [(f64, Option<f64>); 5] = [
    (0.014_352, None),
    (0.067_412, None),
    (0.035_154, Some(35.7634)),
    (0.070_469, Some(29.744_473)),
    (0.092, Some(8.0)),
];

/// Difference of one state, relative to its largest displacement and largest stress.
#[derive(Debug, Serialize)]
struct Difference {
    pressure_mpa: f64,
    gap_mm: Option<f64>,
    largest_displacement_mm: [f64; 2],
    displacement_share: Spread,
    stress_share: Spread,
    force_n: [f64; 2],
    volume_mm3: [f64; 2],
    factorisations: usize,
    residual: f64,
    seconds: f64,
}

/// Mean, 95th percentile and largest over the nodes of the coarser mesh.
#[derive(Debug, Serialize)]
struct Spread([f64; 3]);

impl Spread {
    fn of(mut values: Vec<f64>, largest: f64) -> Self {
        let shares = train::evaluate::spread(&mut values);
        Self(shares.map(|value| value / largest))
    }

    fn text(&self) -> String {
        let [mean, p95, most] = self.0.map(|share| 100.0 * share);
        format!("{mean:.3} / {p95:.3} / {most:.3} %")
    }
}

/// One mesh with its solver.
struct MeshedBody {
    problem: Arc<Problem>,
    solver: Solver,
}

impl MeshedBody {
    fn new(problem: Arc<Problem>) -> anyhow::Result<Self> {
        Ok(Self { solver: Solver::new(Arc::clone(&problem))?, problem })
    }

    fn sizes(&self) -> [usize; 2] {
        [self.problem.mesh().nodes_mm.len(), self.problem.mesh().tets.len()]
    }
}

pub fn run(path: &Path, finer: &Path, book: &mut Book) -> anyhow::Result<()> {
    if !finer.is_file() {
        return Err(usage(format!(
            "--finer-mesh: expected a mesh, found no {}; make it: scripts/mesh.py {} --finer 1.8 --out {}",
            finer.display(),
            path.display(),
            finer.display()
        )));
    }
    let (actuator, problem) = files::actuator(path)?;
    let (mut coarse, mut fine) =
        (MeshedBody::new(problem)?, MeshedBody::new(files::family_on(path, finer)?.problem)?);
    let [a, b] = [coarse.sizes(), fine.sizes()];
    book.remark(&format!(
        "\nwhole actuator, {} nodes and {} elements against {} and {}: {:.2} times in each direction",
        a[0],
        a[1],
        b[0],
        b[1],
        (b[1] as f64 / a[1] as f64).cbrt()
    ))?;
    let (mut state, _) = coarse.solver.gravity_equilibrium(actuator.loads.gravity_mm_s2)?;
    for (pressure, gap) in STATES {
        let load = actuator.load(pressure, gap);
        (state, _) = coarse.solver.solve_to(&state, &load)?;
        let difference = compare(&mut coarse, &mut fine, &state, &load)?;
        print(&difference, book)?;
    }
    Ok(())
}

fn compare(
    coarse: &mut MeshedBody,
    fine: &mut MeshedBody,
    state: &State,
    load: &Load,
) -> anyhow::Result<Difference> {
    let start = fine.solver.transferred(&coarse.problem, state);
    let start = start.ok_or_else(|| {
        usage("--finer-mesh: expected a mesh of the same body; it reaches beyond the actuator's own")
    })?;
    let (finer, report) = fine.solver.solve_to(&start, load)?;
    let (a, b) = (coarse.solver.output(state), fine.solver.output(&finer));
    difference(coarse, fine, (&a, &b), (state, &finer), &report)
}

fn difference(
    coarse: &MeshedBody,
    fine: &MeshedBody,
    (a, b): (&Output, &Output),
    (state, finer): (&State, &State),
    report: &SolveReport,
) -> anyhow::Result<Difference> {
    let locator = Locator::new(&fine.problem);
    let (mut distances, mut stresses) = (Vec::new(), Vec::new());
    for (n, x) in coarse.problem.mesh().nodes_mm.iter().enumerate() {
        let place = locator.place(*x);
        let place = place.ok_or_else(|| {
            usage("--finer-mesh: expected a mesh of the whole actuator, found a part of it")
        })?;
        let (u, v) = (state.displacement_mm[n], place.vector(&finer.displacement_mm));
        distances.push((0..3).map(|k| (u[k] - v[k]).powi(2)).sum::<f64>().sqrt());
        stresses.push((a.von_mises_mpa[n] - place.value(&b.von_mises_mpa)).abs());
    }
    let largest = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
    Ok(Difference {
        pressure_mpa: finer.load.pressure_mpa,
        gap_mm: finer.load.obstacle.gap_mm(),
        largest_displacement_mm: [a, b].map(|output| largest(&output.displacement_mm)),
        displacement_share: Spread::of(distances, largest(&b.displacement_mm)),
        stress_share: Spread::of(stresses, largest(&b.von_mises_mpa)),
        force_n: [a.contact_force_n, b.contact_force_n],
        volume_mm3: [a.cavity_volume_mm3, b.cavity_volume_mm3],
        factorisations: report.factorisations,
        residual: report.residual,
        seconds: report.seconds,
    })
}

fn print(found: &Difference, book: &mut Book) -> anyhow::Result<()> {
    let gap = found.gap_mm.map_or("free".into(), |gap| format!("gap {gap:.3} mm"));
    let change = |[coarse, fine]: [f64; 2]| 100.0 * (coarse / fine - 1.0);
    let force = found.gap_mm.map_or(String::new(), |_| {
        format!(
            ", force {:.5} and {:.5} N ({:+.2} %)",
            found.force_n[0],
            found.force_n[1],
            change(found.force_n)
        )
    });
    book.remark(&format!(
        "{:.6} MPa, {gap}: largest displacement {:.3} and {:.3} mm ({:+.2} %), volume {:+.2} %{force}\n  mean / 95 % / worst node: \
         displacement {}, stress {}; {} factorisations, {:.0} s, residual {:.1e}",
        found.pressure_mpa,
        found.largest_displacement_mm[0],
        found.largest_displacement_mm[1],
        change(found.largest_displacement_mm),
        change(found.volume_mm3),
        found.displacement_share.text(),
        found.stress_share.text(),
        found.factorisations,
        found.seconds,
        found.residual
    ))?;
    book.keep(found)
}
