//! Motion of a model: its regimes as manifold, its evaluation at the moving state.

use super::data::{InertiaModel, MotionWidths, RegimeInertia, StoredLoad, StoredMode};
use super::manifold::{
    Amplitudes, Coordinates, Equilibrium, InertialLoad, LinearMode, MAX_LOADS, Manifold, PlateForce,
    Tangents, dot,
};
use super::stepper::{Motion, MotionSettings, MotionState, MotionStep, PAST_FRACTION, ReadingError};
use crate::clearance::OnsetSolver;
use crate::contract::{self, Output};
use crate::evaluation::Evaluation;
use crate::evaluator::{Evaluator, Query};
use crate::halfwidths::HALFWIDTH_SIGMAS;
use crate::inputs::{GAP, Inputs, PRESSURE};
use crate::model::{BlockKind, Model, ModelError, ModelHeader, RegimeModel};
use crate::regime::LastOnset;
use crate::snapshots::{FieldKind, RegimeKind};
use std::ops::Range;

/// Time between two readings up to which inputs are straight lines, ns.
const HELD_AFTER_NS: u64 = 250_000_000;
/// Time between two readings from which the motion restarts at rest, ns.
const RESTART_AFTER_NS: u64 = 1_000_000_000;

/// One regime over coordinates.
#[derive(Clone, Debug)]
struct RegimePlace {
    kind: RegimeKind,
    mean: Coordinates,
    /// Coordinate of each output of the contracted regime, with its place in the coefficients.
    outputs: Vec<(usize, usize)>,
    modes: Vec<LinearMode>,
    reactions_n: Amplitudes,
}

/// Static model over its M-orthonormal coordinates.
#[derive(Clone, Debug)]
pub struct ModelManifold {
    loads: Vec<InertialLoad>,
    evaluator: Evaluator,
    regimes: Vec<RegimePlace>,
    solver: Option<OnsetSolver>,
    /// Heights of the free regime's linear modes at the nodes of the clearance, mm.
    heights_mm: Vec<Vec<f64>>,
    last: LastOnset,
    scratch: Evaluation,
}

fn padded(values: &[f64]) -> Coordinates {
    let mut all = Coordinates::default();
    all.iter_mut().zip(values).for_each(|(to, from)| *to = *from);
    all
}

impl ModelManifold {
    fn new(header: &ModelHeader, inertia: &InertiaModel) -> Result<Self, ModelError> {
        inertia.check(header).map_err(ModelError::Inconsistent)?;
        let (mut outputs, mut coordinates) = (Vec::new(), Vec::new());
        for (regime, stored) in inertia.regimes.iter().zip(&header.regimes) {
            let (mut wanted, mut at): (Vec<Output>, Vec<usize>) = (Vec::new(), Vec::new());
            let rows = regime.by_coefficient.chunks_exact(stored.coefficient_count().max(1));
            for (coordinate, row) in rows.enumerate() {
                let begin = wanted.len();
                for (group, model) in stored.groups.iter().enumerate() {
                    let weights = row[model.coefficients.clone()].to_vec();
                    if weights.iter().all(|w| *w == 0.0) {
                        continue;
                    }
                    let alike = |output: &&mut Output| {
                        stored.groups[output.parts[0].0].surrogate.shares_kernel_with(&model.surrogate)
                    };
                    match wanted[begin..].iter_mut().find(alike) {
                        Some(output) => output.parts.push((group, weights)),
                        None => {
                            wanted.push(Output { parts: vec![(group, weights)] });
                            at.push(coordinate);
                        }
                    }
                }
            }
            outputs.push(wanted);
            coordinates.push(at);
        }
        let (contracted, places) = contract::contracted(header, &outputs);
        let evaluator = Evaluator::new(&contracted)?.for_search();
        let regime = |(regime, (at, places)): (&RegimeInertia, (&Vec<usize>, &Vec<usize>))| {
            let mode =
                |mode: &StoredMode| LinearMode { rate_rad_s: mode.rate_rad_s, shape: padded(&mode.shape) };
            let mut reactions_n = Amplitudes::default();
            reactions_n.iter_mut().zip(&regime.modes).for_each(|(to, mode)| *to = mode.reaction_n);
            RegimePlace {
                kind: regime.kind,
                mean: padded(&regime.mean),
                outputs: at.iter().copied().zip(places.iter().copied()).collect(),
                modes: regime.modes.iter().map(mode).collect(),
                reactions_n,
            }
        };
        let regimes: Vec<RegimePlace> =
            inertia.regimes.iter().zip(coordinates.iter().zip(&places)).map(regime).collect();
        let free = header.regimes.iter().find(|regime| regime.kind == RegimeKind::Free);
        // Without contact there is nothing to land on.
        let has_contact = regimes.iter().any(|regime| regime.kind == RegimeKind::Contact);
        let clearance = header.clearance.clone().filter(|_| has_contact);
        let solver = clearance.zip(free).map(|(clearance, free)| OnsetSolver::new(clearance, free));
        let heights = inertia.regimes.iter().filter(|regime| regime.kind == RegimeKind::Free);
        let mut scratch = evaluator.evaluation();
        if let Some(solver) = &solver {
            let more = solver.scratch();
            scratch.scratch.reserve(&more.scratch);
            scratch.coefficients.reserve(more.coefficients.capacity());
            scratch.gradients.iter_mut().for_each(|row| row.reserve(more.coefficients.capacity()));
        }
        let load = |load: &StoredLoad| {
            let input = load.input as usize;
            InertialLoad { input, unit: padded(&load.unit), range: header.inputs[input].range }
        };
        Ok(Self {
            loads: inertia.loads.iter().map(load).collect(),
            evaluator,
            regimes,
            solver,
            heights_mm: heights.flat_map(|r| r.modes.iter().map(|mode| mode.heights_mm.clone())).collect(),
            last: LastOnset::default(),
            scratch,
        })
    }

    fn regime(&self, kind: RegimeKind) -> &RegimePlace {
        self.regimes.iter().find(|regime| regime.kind == kind).unwrap_or(&self.regimes[0])
    }
}

impl Manifold for ModelManifold {
    fn forget(&mut self) {
        self.last = LastOnset::default();
    }

    fn loads(&self) -> &[InertialLoad] {
        &self.loads
    }

    fn modes(&self, kind: RegimeKind) -> &[LinearMode] {
        &self.regime(kind).modes
    }

    fn equilibrium(&mut self, kind: RegimeKind, inputs: &Inputs) -> Equilibrium {
        let kind = self.regime(kind).kind;
        let query = Query { range: false, regime: Some(kind), ..Query::GRADIENTS };
        self.evaluator.answer(*inputs, query, &mut self.scratch);
        let regime = self.regime(kind);
        let mut equilibrium = Equilibrium {
            position: regime.mean,
            tangents: Tangents::default(),
            by_pressure: Coordinates::default(),
        };
        let slopes = self.scratch.coefficient_gradient(PRESSURE);
        for (coordinate, at) in &regime.outputs {
            equilibrium.position[*coordinate] += self.scratch.coefficients[*at];
            equilibrium.by_pressure[*coordinate] += slopes[*at];
        }
        for (load, tangent) in self.loads.iter().zip(&mut equilibrium.tangents) {
            let slopes = self.scratch.coefficient_gradient(load.input);
            regime.outputs.iter().for_each(|(coordinate, at)| tangent[*coordinate] += slopes[*at]);
        }
        equilibrium
    }

    fn clearance_mm(&mut self, inputs: &Inputs, amplitudes: &Amplitudes) -> f64 {
        let Some(solver) = self.solver.as_ref().filter(|_| inputs.gap_mm().is_finite()) else {
            return f64::INFINITY;
        };
        let heights = &self.heights_mm;
        let further =
            |node: usize| heights.iter().zip(amplitudes).map(|(mode, y)| mode[node] * y).sum::<f64>();
        solver.lowest_mm(inputs, further, &mut self.scratch) + inputs.gap_mm()
    }

    fn onset_load(&mut self, inputs: &Inputs) -> f64 {
        let found = self
            .solver
            .as_ref()
            .and_then(|solver| solver.touching(self.loads[0].input, inputs, &mut self.scratch));
        found.unwrap_or(inputs.values()[self.loads[0].input])
    }

    fn force(&mut self, inputs: &Inputs, amplitudes: &Amplitudes) -> PlateForce {
        let found = self.evaluator.signed_force(*inputs, &mut self.last, &mut self.scratch);
        let Some((n, gradient)) = found else { return PlateForce::default() };
        let by_amplitude = self.regime(RegimeKind::Contact).reactions_n;
        let n = n + by_amplitude.iter().zip(amplitudes).map(|(by, y)| by * y).sum::<f64>();
        let mut by_load = [0.0; MAX_LOADS];
        by_load.iter_mut().zip(&self.loads).for_each(|(by, load)| *by = gradient[load.input]);
        PlateForce { n, by_load, by_gap: gradient[GAP], by_amplitude }
    }
}

/// Evaluation of the stress under all of the load that a relaxing elastomer bears.
#[derive(Clone, Debug)]
struct Stress {
    /// Coefficients of groups that hold the stress alone, by regime.
    ranges: Vec<(RegimeKind, Vec<Range<usize>>)>,
    last: LastOnset,
    evaluation: Evaluation,
}

impl Stress {
    fn new(header: &ModelHeader, evaluation: Evaluation) -> Self {
        let is_stress = |field: &usize| header.fields[*field].spec.kind == FieldKind::Stress;
        let stress_ranges = |regime: &RegimeModel| {
            let groups = regime.groups.iter().filter(|group| group.fields.iter().all(is_stress));
            (regime.kind, groups.map(|group| group.coefficients.clone()).collect())
        };
        Self {
            ranges: header.regimes.iter().map(stress_ranges).collect(),
            last: LastOnset::default(),
            evaluation,
        }
    }
}

/// A moving model: steps by the time of its readings.
#[derive(Clone, Debug)]
pub struct ModelMotion {
    motion: Motion<ModelManifold>,
    evaluator: Evaluator,
    /// Coefficients of the linear modes, by regime.
    modes: Vec<(RegimeKind, Vec<Vec<f64>>)>,
    /// Onset of the evaluation.
    last: LastOnset,
    /// If the elastomer relaxes.
    stress: Option<Stress>,
    widths: MotionWidths,
}

impl ModelMotion {
    /// Motion of a model; `None` for a static model.
    ///
    /// # Errors
    /// [`ModelError::Inconsistent`] when its inertia does not fit its header.
    pub fn new(model: &Model) -> Result<Option<Self>, ModelError> {
        let found = model.record::<InertiaModel>(BlockKind::Inertia);
        let found = found.map_err(|error| ModelError::Inconsistent(error.to_string()))?;
        let Some(inertia) = found else { return Ok(None) };
        let manifold = ModelManifold::new(&model.header, &inertia)?;
        let settings = MotionSettings {
            step_ns: inertia.step_ns,
            damping_s: inertia.damping_s,
            held_after_ns: HELD_AFTER_NS,
            restart_after_ns: RESTART_AFTER_NS,
        };
        let linear_modes = |regime: &RegimeInertia| {
            (regime.kind, regime.modes.iter().map(|mode| mode.coefficients.clone()).collect())
        };
        let evaluator = Evaluator::new(&model.header)?;
        let relaxes = !inertia.prony.is_empty();
        Ok(Some(Self {
            motion: Motion::new(manifold, settings).relaxing(&inertia.prony),
            stress: relaxes.then(|| Stress::new(&model.header, evaluator.evaluation())),
            evaluator,
            modes: inertia.regimes.iter().map(linear_modes).collect(),
            last: LastOnset::default(),
            widths: inertia.widths,
        }))
    }

    /// Treats all readings as instants of one recording: inputs are straight lines between any two of them.
    /// They begin at rest.
    pub fn as_recording(&mut self) {
        self.motion.as_recording();
    }

    /// Evaluation with capacity for any state.
    pub fn evaluation(&self) -> Evaluation {
        self.evaluator.evaluation()
    }

    /// Forgets the motion: the next reading begins at rest.
    pub fn reset(&mut self) {
        self.motion.reset();
    }

    /// Amplitude of the body per first load at an equilibrium, mm per mm/s2.
    pub fn amplitude_per_load(&mut self, kind: RegimeKind, inputs: Inputs) -> f64 {
        let inputs = self.evaluator.with_defaults(inputs);
        let manifold = self.motion.manifold();
        let tangent = manifold.equilibrium(kind, &inputs).tangents[0];
        let unit = manifold.loads[0].unit;
        (dot(&tangent, &tangent) / dot(&unit, &unit)).sqrt()
    }

    /// Moves to a reading and evaluates the moving state: the inputs of the evaluation contain the inertial loads. Inputs that the reading
    /// does not set take the model's value. Allocates nothing.
    ///
    /// # Errors
    /// [`ReadingError`]; motion and evaluation are unchanged.
    pub fn advance(
        &mut self,
        t_ns: u64,
        inputs: Inputs,
        out: &mut Evaluation,
    ) -> Result<MotionStep, ReadingError> {
        let moved = self.motion.advance(t_ns, &self.evaluator.with_defaults(inputs))?;
        self.evaluate(&moved, out);
        Ok(moved)
    }

    /// Refuses a reading that [`Self::advance`] does not take.
    ///
    /// # Errors
    /// [`ReadingError`].
    pub fn check(&self, t_ns: u64, inputs: &Inputs) -> Result<(), ReadingError> {
        self.motion.check(t_ns, &self.evaluator.with_defaults(*inputs))
    }

    /// The motion without evaluation; it needs all inputs of the model.
    pub fn stepper(&mut self) -> &mut Motion<ModelManifold> {
        &mut self.motion
    }

    /// Evaluates a moving state. Allocates nothing.
    pub fn evaluate(&mut self, moved: &MotionStep, out: &mut Evaluation) {
        let state = &moved.state;
        if moved.at_rest {
            self.last = LastOnset::default();
        }
        let query = |near| Query { regime: Some(state.regime), near: Some(near), ..Query::COEFFICIENTS };
        self.evaluator.answer(state.shown.0, query(&mut self.last), out);
        if let Some(Stress { ranges, last, evaluation }) = &mut self.stress {
            if moved.at_rest {
                *last = LastOnset::default();
            }
            self.evaluator.answer(state.stressed, query(last), evaluation);
            let of_regime = ranges.iter().filter(|(kind, _)| *kind == state.regime);
            for range in of_regime.flat_map(|(_, ranges)| ranges) {
                out.coefficients[range.clone()].copy_from_slice(&evaluation.coefficients[range.clone()]);
            }
        }
        out.inputs = state.inputs;
        // A motion that left the range between two readings is as uncertain as one that is outside at the reading.
        if moved.load_distance > out.domain_distance {
            out.set_distance(moved.load_distance);
        }
        out.contact_force_n = if out.flags.no_force { f64::NAN } else { state.contact_force_n };
        let widths = self.widths.at(&state.fading_mm, out.halfwidths.coverage);
        out.halfwidths = out.halfwidths.with(&widths);
        self.add_modes(state, out);
        self.evaluator.check_shape(out);
    }

    /// Adds the linear modes of a moving state to its coefficients.
    pub fn add_modes(&self, state: &MotionState, out: &mut Evaluation) {
        let modes = self.modes.iter().find(|(kind, _)| *kind == state.regime);
        for (mode, y) in modes.iter().flat_map(|(_, modes)| modes).zip(&state.shown.1) {
            out.coefficients.iter_mut().zip(mode).for_each(|(c, by)| *c += y * by);
        }
    }

    /// Positions of the inertial loads in the inputs.
    pub fn load_inputs(&mut self) -> Vec<usize> {
        self.motion.manifold().loads.iter().map(|load| load.input).collect()
    }

    /// Standard deviations before any reading of the first load (mm/s2) and of the velocity along its tangent (mm/s3): those of a swing that
    /// an unknown past may have left; and of the frequency, as a fraction.
    pub fn unknown_swing(&mut self) -> [f64; 3] {
        let rest = self.evaluator.with_defaults(Inputs::new(0.0, f64::INFINITY));
        let manifold = self.motion.manifold();
        let tangent = manifold.equilibrium(RegimeKind::Free, &rest).tangents[0];
        let InertialLoad { unit, range: [low, high], .. } = &manifold.loads[0];
        let rate = (dot(unit, &tangent).abs() / dot(&tangent, &tangent)).sqrt();
        let load = PAST_FRACTION * (high - low);
        // A swing's path is four amplitudes per period; an error of its phase is one of position.
        [load, load * rate, 4.0 * self.widths.swing[0] / std::f64::consts::TAU / HALFWIDTH_SIGMAS]
    }
}
