//! Inertia of a trained model from the finite elements of its actuator.

use crate::actuator::Actuator;
use crate::config::Load;
use crate::linear::LinearError;
use crate::problem::Problem;
use crate::solver::{SolveError, Solver};
use crate::vibration::{self, BodyMass, VibrationError};
use rom::inertia::data::MotionWidths;
use rom::inertia::manifold::MAX_LINEAR_MODES;
use rom::inertia::model_motion::ModelMotion;
use rom::inputs::{Inputs, PARAMETERS, PRESSURE};
use rom::memory::{Creep, InputMemory, MemorySpec, PronyTerm, Slopes, filter};
use rom::model::{BlockKind, Model, ModelError, ModelFileError};
use rom::snapshots::{Case, Database, RegimeKind, Split, Vibration};
use rom::statistics::{ends, median};
use std::sync::Arc;
use train::TrainError;
use train::inertia::{Mass, Nodal, reduce};
use train::memory::slopes;

/// Name of the inertial load along each axis; a body lands along the first that its cases vary, of y, x and z.
const LOADS: [&str; 3] = ["loads.gravity_mm_s2.0", "loads.gravity_mm_s2.1", "loads.gravity_mm_s2.2"];
const ORDER: [usize; 3] = [1, 0, 2];
/// Linear modes of a regime in addition to one load, and for each further load.
const MODES: [usize; 2] = [3, 1];
/// Vibrations among which they are sought: those across the loads are left out.
const SOUGHT: usize = 12;
/// Least part of the mass, as a square root, that takes part in a vibration along a load.
const LEAST_PART: f64 = 0.03;
/// Half-widths of displacement, stress and contact force, as fractions of what the path of the motion changes in them, and of what a swing
/// with the velocity that an impact took would change.
const SWING: [f64; 3] = [0.02, 0.06, 0.06];
const IMPACT: [f64; 3] = [0.4, 0.4, 0.6];
/// Training cases at which the change per amplitude is taken.
const WIDTH_CASES: usize = 12;
/// Time between two readings from which the last pressure is held and the past is unknown, s.
const LONGEST_GAP_S: f64 = 1.0;
/// Length of the inner steps, ns.
const STEP_NS: u64 = 500_000;

/// Why a model gets no inertia.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the messages say what the values are
pub enum InertiaError {
    /// The cases of the database vary no inertial load.
    #[error(
        "--inertia: expected a column {name} in the database's cases, found none; `softtwin sample --parameter {name}=LOW:HIGH` makes one"
    )]
    NoLoad { name: &'static str },
    /// The actuator is not that of the database.
    #[error("--inertia: expected the actuator of the database, with {expected} nodes, found {found}")]
    OtherActuator { expected: usize, found: usize },
    /// The relaxation of its elastomer cannot be used.
    #[error("dynamics.prony: {0}")]
    Prony(String),
    /// The model could not be reduced.
    #[error(transparent)]
    Train(#[from] TrainError),
    /// A state could not be solved.
    #[error(transparent)]
    Solve(#[from] SolveError),
    /// A factor does not fit into memory.
    #[error(transparent)]
    Memory(#[from] LinearError),
    /// Vibrations could not be found.
    #[error(transparent)]
    Vibration(#[from] VibrationError),
    /// The inertia does not fit the model.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The inertia cannot be written.
    #[error(transparent)]
    File(#[from] ModelFileError),
}

/// Mass and loads of the actuator of a database.
pub struct InertialBody {
    actuator: Actuator,
    problem: Arc<Problem>,
    mass: BodyMass,
    axes: Vec<usize>,
}

impl InertialBody {
    /// The actuator of a database whose cases vary an inertial load.
    ///
    /// # Errors
    /// No load varies between the cases; another actuator.
    pub fn new(database: &Database, actuator: Actuator, problem: Arc<Problem>) -> Result<Self, InertiaError> {
        let varies = |axis: &usize| database.parameters.iter().any(|p| p.name == LOADS[*axis]);
        let axes: Vec<usize> = ORDER.into_iter().filter(varies).collect();
        if axes.is_empty() {
            return Err(InertiaError::NoLoad { name: LOADS[1] });
        }
        let (expected, found) = (database.node_count, problem.mesh().nodes_mm.len());
        if found != expected {
            return Err(InertiaError::OtherActuator { expected, found });
        }
        Ok(Self { actuator, mass: BodyMass::new(Arc::clone(&problem)), problem, axes })
    }

    /// Linear modes of the regimes that the database has, and lines for the user.
    ///
    /// # Errors
    /// A state cannot be solved or is not stable.
    pub fn vibrations(&self, database: &Database) -> Result<(Vec<Vibration>, Vec<String>), InertiaError> {
        let (mut vibrations, mut lines) = (Vec::new(), Vec::new());
        let unit_loads: Vec<Nodal> = self.axes.iter().map(|axis| self.unit_load(*axis)).collect();
        let total_t: f64 = self.mass.node_mass_t().iter().sum();
        for regime in [RegimeKind::Free, RegimeKind::Contact] {
            let Some(case) = middle(database, regime) else { continue };
            let found = self.slowest(&self.load(database, case))?;
            let vibration = |found: vibration::Vibration| Vibration {
                regime,
                rate_rad_s: found.rate_rad_s,
                shape_mm: by_axis(&found.shape_mm),
                reaction_n: found.reaction_n,
            };
            // The load along which it moves most, where it moves along one.
            let moves = |v: &Vibration| {
                let along =
                    unit_loads.iter().map(|unit| v.shape_mm.iter().zip(unit).map(|(x, m)| x * m).sum());
                let along = along.map(f64::abs).enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
                along.filter(|(_, part)| *part > LEAST_PART * total_t.sqrt()).map(|(load, _)| load)
            };
            // Each load contains the slowest along it.
            let mut contained = vec![false; self.axes.len()];
            let (mut hertz, mut taken) = (Vec::new(), Vec::new());
            for v in found.into_iter().map(vibration) {
                let Some(load) =
                    moves(&v).filter(|_| taken.len() < MODES[0] + MODES[1] * (self.axes.len() - 1))
                else {
                    continue;
                };
                hertz.push(format!("{:.2}", v.rate_rad_s / std::f64::consts::TAU));
                if std::mem::replace(&mut contained[load], true) {
                    taken.push(v);
                }
            }
            lines.push(format!("{}, case {}: {} Hz", regime.name(), case.name, hertz.join(", ")));
            vibrations.extend(taken.into_iter().take(MAX_LINEAR_MODES));
        }
        Ok((vibrations, lines))
    }

    /// Adds the inertia to a model that was trained on this database with these vibrations.
    ///
    /// # Errors
    /// Model and database do not fit.
    pub fn add_to(&self, model: &mut Model, database: &Database) -> Result<Vec<String>, InertiaError> {
        let times = |v: &[f64]| by_axis(&self.mass.times(&by_node(v)));
        let mass = Mass {
            loads: self.axes.iter().map(|axis| (LOADS[*axis], self.unit_load(*axis))).collect(),
            times: &times,
            damping_s: self.actuator.dynamics.beta_s,
            step_ns: STEP_NS,
            prony: self.prony(),
        };
        let reduced = reduce(model, database, &mass)?;
        let line = |(kind, part): &(RegimeKind, f64)| {
            format!("{}: {:.2} % of a linear mode is not in the model's modes", kind.name(), 100.0 * part)
        };
        let mut lines = vec![format!("{} coordinates", reduced.inertia.coordinates())];
        lines.extend(reduced.outside.iter().map(line));
        let mut inertia = reduced.inertia;
        model.set_record(BlockKind::Inertia, &inertia)?;
        inertia.widths = widths(model, database, inertia.loads[0].input as usize)?;
        model.set_record(BlockKind::Inertia, &inertia)?;
        if !inertia.prony.is_empty() {
            let memory = self.filter(model, database)?;
            for Creep { time_s, weight } in memory.inputs.iter().flat_map(|input| &input.creep) {
                lines.push(format!("pressure behind the relaxation: weight {weight:.4}, {time_s:.4} s"));
            }
            model.set_record(BlockKind::Memory, &memory)?;
        }
        Ok(lines)
    }

    fn prony(&self) -> Vec<PronyTerm> {
        let terms = self.actuator.dynamics.ratios().into_iter();
        terms.map(|(ratio, time_s)| PronyTerm { ratio, time_s }).collect()
    }

    /// Load filter of the relaxing elastomer on the pressure.
    fn filter(&self, model: &Model, database: &Database) -> Result<MemorySpec, InertiaError> {
        let creep = filter(&self.prony()).map_err(InertiaError::Prony)?;
        let range = model.header.inputs[PRESSURE].range;
        let states: Vec<Inputs> = width_cases(database).into_iter().map(inputs_of).collect();
        let slopes = slopes(model, &states, PRESSURE, range);
        let (line, orifice, play) = (None, None, Vec::new());
        let pressure = InputMemory { input: PRESSURE, range, line, orifice, play, creep, slopes };
        Ok(MemorySpec { inputs: vec![pressure], max_gap_s: LONGEST_GAP_S })
    }

    /// Force of a unit of the load along an axis on each node.
    fn unit_load(&self, axis: usize) -> Nodal {
        let nodes = self.mass.node_mass_t();
        let mut unit_load = vec![0.0; 3 * nodes.len()];
        unit_load[axis * nodes.len()..][..nodes.len()].copy_from_slice(nodes);
        unit_load
    }

    fn load(&self, database: &Database, case: &Case) -> Load {
        let mut load = self.actuator.load(case.pressure_mpa, case.gap_mm);
        for (parameter, value) in database.parameters.iter().zip(&case.parameters) {
            if let Some(axis) = LOADS.iter().position(|name| *name == parameter.name) {
                load.gravity_mm_s2[axis] = *value;
            }
        }
        load
    }

    fn slowest(&self, load: &Load) -> Result<Vec<vibration::Vibration>, InertiaError> {
        let mut solver = Solver::new(Arc::clone(&self.problem))?;
        let (rest, _) = solver.gravity_equilibrium(load.gravity_mm_s2)?;
        let (state, _) = solver.solve_to(&rest, load)?;
        Ok(solver.vibrations(&state, SOUGHT)?)
    }
}

/// Training cases at which changes are taken.
fn width_cases(database: &Database) -> Vec<&Case> {
    let cases: Vec<&Case> = database.of_split(Split::Train).map(|i| &database.cases[i]).collect();
    let step = cases.len().div_ceil(WIDTH_CASES).max(1);
    cases.into_iter().step_by(step).collect()
}

fn inputs_of(case: &Case) -> Inputs {
    let inputs = Inputs::new(case.pressure_mpa, case.gap_mm.unwrap_or(f64::INFINITY));
    (PARAMETERS..).zip(&case.parameters).fold(inputs, |inputs, (at, value)| inputs.with(at, *value))
}

/// Half-widths of a motion: fractions of what a swing changes in displacement, stress and contact force.
fn widths(model: &Model, database: &Database, load_input: usize) -> Result<MotionWidths, InertiaError> {
    let Some(mut motion) = ModelMotion::new(model)? else { return Ok(MotionWidths::default()) };
    let range = model.header.inputs[load_input].range;
    let mut changes: [Vec<f64>; 3] = Default::default();
    for case in width_cases(database) {
        let inputs = inputs_of(case);
        let touches = case.contact_force_n > 0.0;
        let regime = if touches { RegimeKind::Contact } else { RegimeKind::Free };
        let amplitude = motion.amplitude_per_load(regime, inputs);
        let Slopes { displacement_mm, stress_mpa, force_n } = slopes(model, &[inputs], load_input, range);
        for (k, slope) in [displacement_mm, stress_mpa, force_n].into_iter().enumerate() {
            changes[k].extend((amplitude > 0.0 && (k < 2 || touches)).then_some(slope / amplitude));
        }
    }
    let per_mm = changes.map(|values| median(values).unwrap_or_default());
    let times = |fractions: [f64; 3]| std::array::from_fn(|k| fractions[k] * per_mm[k]);
    Ok(MotionWidths { swing: times(SWING), impact: times(IMPACT), past: per_mm })
}

/// Case in the middle of a regime's training cases, nearest to the load at rest.
fn middle(database: &Database, kind: RegimeKind) -> Option<&Case> {
    let touches = |case: &&Case| (case.contact_force_n > 0.0) == (kind == RegimeKind::Contact);
    let cases: Vec<&Case> =
        database.of_split(Split::Train).map(|i| &database.cases[i]).filter(touches).collect();
    let loads =
        |case: &Case| [case.pressure_mpa, case.gap_mm.filter(|_| kind == RegimeKind::Contact).unwrap_or(0.0)];
    let distance = |case: &Case| {
        let mut sum = 0.0;
        for (index, value) in loads(case).into_iter().enumerate() {
            let [low, high] = ends(cases.iter().map(|other| loads(other)[index]));
            sum += if high > low { ((value - 0.5 * (low + high)) / (high - low)).powi(2) } else { 0.0 };
        }
        for (index, (value, parameter)) in case.parameters.iter().zip(&database.parameters).enumerate() {
            let [low, high] = ends(cases.iter().map(|other| other.parameters[index]));
            sum += if high > low { ((value - parameter.nominal) / (high - low)).powi(2) } else { 0.0 };
        }
        sum
    };
    cases.iter().copied().min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

fn by_node(v: &[f64]) -> Vec<[f64; 3]> {
    let nodes = v.len() / 3;
    (0..nodes).map(|n| [v[n], v[nodes + n], v[2 * nodes + n]]).collect()
}

fn by_axis(v: &[[f64; 3]]) -> Nodal {
    (0..3).flat_map(|axis| v.iter().map(move |at| at[axis])).collect()
}
