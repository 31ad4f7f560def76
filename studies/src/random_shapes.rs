//! `softtwin-studies random-shapes`: actuators of random sizes, materials and loads are meshed and solved, or refused with a reason.

use fem::actuator::{Actuator, Setting};
use fem::{Mesh, Problem, Solver};
use rom::rng::Rng;
use softtwin::files::refusal;
use softtwin::output;
use std::collections::BTreeMap;
use std::panic::AssertUnwindSafe;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// How it ended, with its figures or the reason.
type Outcome = (&'static str, String);
const PANIC: &str = "panic";

/// Quantities that vary, with the range of their factor or, where they begin at 0, of their value.
const FACTORS: [(&str, f64, f64); 14] = [
    ("base.width_mm", 0.5, 2.0),
    ("base.upper_mm", 0.3, 3.0),
    ("body.width_mm", 0.5, 1.6),
    ("body.top_mm", 0.6, 1.5),
    ("chambers.length_mm", 0.5, 2.0),
    ("chambers.width_mm", 0.5, 1.3),
    ("chambers.top_mm", 0.7, 1.1),
    ("slots.width_mm", 0.3, 3.0),
    ("slots.floor_mm", 0.9, 1.6),
    ("channels.top_mm", 0.8, 1.2),
    ("elastomer.law.mu_mpa", 0.05, 2.0),
    ("sheet.youngs_mpa", 0.01, 2.0),
    ("sheet.thickness_mm", 0.3, 5.0),
    ("base.lower_mm", 0.0, 2.0),
];
/// Pressure over the shear modulus.
const PRESSURE: [f64; 2] = [0.01, 0.1];
/// Longest edge of an element (mm).
const SIZE_MM: f64 = 9.0;
/// Faces that are held.
const HELD: [&str; 7] =
    ["body-start", "base-start", "body-end", "base-end", "body-top", "base-front", "base-back"];
/// One of this number of actuators is of a mesh file.
const FILE_EVERY: usize = 5;
/// Their folders: cavities, materials, films, folds.
const FILES: [&str; 4] = ["two-chambers", "skeleton", "wound-tube", "bellows"];
/// Begins of the keys that vary there, by factors of 0.3 to 3.
const FILE_KEYS: [&str; 4] = ["elastomer.law.", "materials.", "films.", "loads.gravity"];

/// Mesh and solve actuators of random sizes.
#[derive(clap::Args)]
pub struct Args {
    /// Number of actuators.
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = softtwin::range::count(1, 100_000))]
    count: usize,
    /// Seed of the sizes.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// The actuator that is varied.
    #[arg(long, value_name = "FILE.toml", default_value = "models/pneunet/actuator.toml")]
    actuator: PathBuf,
    /// Folder of the actuators of mesh files.
    #[arg(long, value_name = "DIR", default_value = "models/shapes")]
    shapes: PathBuf,
}

impl Args {
    /// Prints one line per actuator and the number of each outcome.
    ///
    /// # Errors
    /// The actuator cannot be read.
    pub fn run(self) -> anyhow::Result<()> {
        let nominal = Actuator::read(&self.actuator).map_err(refusal)?;
        let mut rng = Rng::new(self.seed);
        let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
        for k in 0..self.count {
            let began = Instant::now();
            let found = std::panic::catch_unwind(AssertUnwindSafe(|| self.outcome(k, &nominal, &mut rng)));
            let (outcome, detail) = found.unwrap_or_else(|_| Ok((PANIC, String::new())))?;
            *counts.entry(outcome).or_default() += 1;
            output!("{k:>4} {outcome:<11} {:>5.1} s  {detail}", began.elapsed().as_secs_f64())?;
        }
        output!("{counts:?}")?;
        anyhow::ensure!(!counts.contains_key(PANIC), "an actuator ended in a panic");
        Ok(())
    }

    fn outcome(&self, k: usize, nominal: &Actuator, rng: &mut Rng) -> anyhow::Result<Outcome> {
        if k % FILE_EVERY != FILE_EVERY - 1 {
            return Ok(of_boxes(nominal, rng));
        }
        let name = FILES[rng.below(FILES.len())];
        let path = self.shapes.join(name).join("actuator.toml");
        let actuator = Actuator::read(&path).map_err(refusal)?;
        let (outcome, detail) = of_file(&actuator, &path, rng);
        Ok((outcome, format!("{name}: {detail}")))
    }
}

/// Actuator of at most four chambers, with parts left out and added at random.
fn varied(nominal: &Actuator, rng: &mut Rng) -> (Actuator, Vec<Setting>) {
    let mut actuator = nominal.clone();
    if let (Some(base), Some(body), Some(row)) =
        (&mut actuator.base, &mut actuator.body, &mut actuator.chambers)
    {
        let less_mm = row.pitch_mm * (row.count as f64 - (1 + rng.below(4)) as f64);
        row.count = ((row.count as f64 * row.pitch_mm - less_mm) / row.pitch_mm).round() as usize;
        (body.length_mm, base.length_mm) = (body.length_mm - less_mm, base.length_mm - less_mm);
        if rng.below(4) == 0 {
            row.lengths_mm = (0..row.count).map(|_| row.length_mm * (0.6 + 0.6 * rng.uniform())).collect();
        }
        if rng.below(4) == 0 {
            row.tops_mm = (0..row.count).map(|_| row.top_mm * (0.6 + 0.4 * rng.uniform())).collect();
        }
        if rng.below(4) == 0 {
            row.opposite = Some("opposite".into());
            actuator.pressure_mpa.insert("opposite".into(), 0.02 * rng.uniform());
        }
    }
    if let (Some(slots), 0) = (&mut actuator.slots, rng.below(4)) {
        slots.side_mm = 8.0 * rng.uniform();
    }
    if rng.below(2) == 0 {
        actuator.support.fixed = HELD[rng.below(HELD.len())].into();
    }
    actuator.mesh.nodes = 0;
    let hangs = rng.below(3);
    let gravity = [[0.0, -9810.0, 0.0], [9810.0, 0.0, 0.0], [0.0, 9810.0, 0.0]];
    actuator.loads.gravity_mm_s2 = gravity[hangs];
    if rng.below(4) == 0 {
        actuator.slots = None;
    }
    if rng.below(4) == 0 {
        actuator.sheet = None;
    }
    let mut settings = Vec::new();
    for (name, low, high) in FACTORS {
        let factor = low + (high - low) * rng.uniform();
        if let Ok(value) = actuator.quantity(name).map(|value| value * factor)
            && rng.below(3) == 0
        {
            settings.push((name.to_owned(), (1e3 * value).round() / 1e3));
        }
    }
    (actuator, settings)
}

fn listed(list: &[formats::Diagnostic]) -> String {
    list.first().map_or(String::new(), |first| format!("{first} ({} in all)", list.len()))
}

/// Pressure over the shear modulus.
fn share(rng: &mut Rng) -> f64 {
    PRESSURE[0] + (PRESSURE[1] - PRESSURE[0]) * rng.uniform()
}

fn of_file(actuator: &Actuator, path: &Path, rng: &mut Rng) -> Outcome {
    let mut settings = Vec::new();
    for (name, value) in actuator.quantities() {
        let varies = FILE_KEYS.iter().any(|key| name.starts_with(key)) && rng.below(2) == 0;
        if varies {
            settings.push((name, value * 0.3 * 10.0_f64.powf(rng.uniform())));
        } else if name.starts_with("pressure_mpa.") {
            settings.push((name, 0.1 * rng.uniform() * actuator.elastomer.law.shear_modulus_mpa()));
        }
    }
    let share = share(rng);
    match (actuator.with(&settings), actuator.read_mesh(path)) {
        (Err(list), _) => ("refused", listed(&list)),
        (_, Err(error)) => ("not meshed", error.to_string()),
        (Ok(actuator), Ok(mesh)) => solved(&actuator, mesh, share),
    }
}

fn of_boxes(nominal: &Actuator, rng: &mut Rng) -> Outcome {
    let (actuator, settings) = varied(nominal, rng);
    let share = share(rng);
    let actuator = match actuator.with(&settings) {
        Ok(actuator) => actuator,
        Err(list) => return ("refused", listed(&list)),
    };
    match actuator.grid_mesh(SIZE_MM, 1) {
        Ok(mesh) => solved(&actuator, mesh, share),
        Err(list) => ("not meshed", listed(&list)),
    }
}

/// Rest under gravity, then the state under pressure.
fn solved(actuator: &Actuator, mesh: Mesh, share: f64) -> Outcome {
    let problem = match Problem::new(mesh, actuator.problem_config()) {
        Ok(problem) => Arc::new(problem),
        Err(error) => return ("refused", error.to_string()),
    };
    let nodes = problem.mesh().nodes_mm.len();
    let pressure_mpa = share * actuator.elastomer.law.shear_modulus_mpa();
    let solved = Solver::new(problem).map_err(|error| error.to_string()).and_then(|mut solver| {
        let (rest, _) =
            solver.gravity_equilibrium(actuator.loads.gravity_mm_s2).map_err(|e| e.to_string())?;
        let (state, _) =
            solver.solve_to(&rest, &actuator.load(pressure_mpa, None)).map_err(|e| e.to_string())?;
        let largest = solver.output(&state).displacement_mm.into_iter().fold(0.0, f64::max);
        Ok(format!("{nodes} nodes, {pressure_mpa:.4} MPa, moves by {largest:.1} mm"))
    });
    match solved {
        Ok(detail) => ("solved", detail),
        Err(reason) => ("no state", format!("{nodes} nodes, {pressure_mpa:.4} MPa: {reason}")),
    }
}
