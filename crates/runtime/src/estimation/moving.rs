//! States that readings do not contain: pasts of the inputs' memory, motion of the body.

use estimate::{MAX_INPUTS, Measurement, MotionEnd, MotionState, PASTS, Setup, Unknown};
use rom::evaluation::Evaluation;
use rom::inertia::model_motion::ModelMotion;
use rom::inertia::stepper::{MotionArrival, MotionStep, SavedMotion};
use rom::inputs::{GAP, InputSpec, Inputs};
use rom::memory::{InputMemory, MemorySpec};
use rom::model::Model;
use rom::session::Session;
use rom::snapshots::RegimeKind;

/// Longest inner step, ns: its error is far below that of a reading.
const STEP_NS: u64 = 2_000_000;

/// An input with a memory whose past the readings do not show.
pub(super) struct RememberedInput {
    /// Position in the model's inputs.
    input: usize,
    /// Unknowns of its past: one, and a second for the creep where that can differ from the rest.
    unknowns: usize,
}

/// The inputs of a model that need an unknown past.
pub(super) fn remembered_inputs(model: &Model) -> Result<Vec<RememberedInput>, String> {
    let spec = MemorySpec::of(model).map_err(|error| format!("model: {error}"))?;
    let remembered = |memory: &InputMemory| RememberedInput {
        input: memory.input,
        unknowns: 1 + usize::from(memory.has_two_pasts()),
    };
    Ok(spec.map_or_else(Vec::new, |spec| spec.inputs.iter().map(remembered).collect()))
}

/// The unknown pasts, in the order of the inputs: -1 is the lowest that an input has been, 1 the highest.
pub(super) fn unknown_pasts(inputs: &[InputSpec], remembered: &[RememberedInput]) -> Vec<Unknown> {
    let unknowns = |past: &RememberedInput| {
        let name = inputs.get(past.input).map_or(String::new(), |input| input.name.clone());
        ["past", "creep_past"].into_iter().take(past.unknowns).map(move |kind| Unknown {
            name: format!("{name}_{kind}"),
            prior: 0.0,
            sigma: 1.0,
            drift_per_sqrt_s: 0.0,
            range: [-1.0, 1.0],
        })
    };
    remembered.iter().flat_map(unknowns).collect()
}

/// Positions of an input's pasts among all unknowns, of which `before` come before the first past.
pub(super) fn past_positions(
    input: usize,
    remembered: &[RememberedInput],
    before: usize,
) -> [Option<usize>; PASTS] {
    let mut first = before;
    for past in remembered {
        if past.input == input {
            return [Some(first), (past.unknowns > 1).then_some(first + 1)];
        }
        first += past.unknowns;
    }
    [None; PASTS]
}

/// What the estimation has to find of a swinging body.
pub(super) struct UnknownSwing {
    /// Position of the inertial load in the model's inputs.
    pub(super) input: usize,
    /// The load and its rate.
    pub(super) unknowns: [Unknown; 2],
    /// Relative error of the model's frequency.
    pub(super) frequency_error: f64,
}

/// `None` for a model without inertia.
pub(super) fn unknown_swing(model: &Model) -> Result<Option<UnknownSwing>, String> {
    let Some(mut motion) = ModelMotion::new(model).map_err(|error| format!("model: {error}"))? else {
        return Ok(None);
    };
    let [load_sigma, rate_sigma, frequency_error] = motion.unknown_swing();
    let Some(input) = motion.load_inputs().first().copied() else { return Ok(None) };
    let rest = model.header.inputs.get(input).and_then(|input| input.value).unwrap_or(f64::NAN);
    let [low, high] = model.header.inputs.get(input).map_or([f64::NAN; 2], |input| input.range);
    let unknown = |name: &str, prior, sigma, range| Unknown {
        name: name.into(),
        prior,
        sigma,
        drift_per_sqrt_s: 0.0,
        range,
    };
    let load = unknown("inertial_load_mm_s2", rest, load_sigma, [2.0 * low - high, 2.0 * high - low]);
    let end = rate_sigma * (high - low) / load_sigma;
    let rate = unknown("inertial_load_rate_mm_s3", 0.0, rate_sigma, [-4.0 * end, 4.0 * end]);
    Ok(Some(UnknownSwing { input, unknowns: [load, rate], frequency_error }))
}

/// Effect of an unknown past, in standard deviations of a reading, from which a reading after a gap is used again.
const FADED_SIGMAS: f64 = 0.1;

/// Passes the inputs of readings, in the order of their times, through a model's memory. Readings after a gap have no inputs until the
/// effect of the gap has faded, because only the past before the first reading is an unknown of the fit.
pub fn filter(session: &mut Session, setup: &Setup, readings: &mut [Measurement]) {
    let begin_s = readings.first().map_or(0.0, |reading| reading.t_s);
    let mut is_after_gap = false;
    for reading in readings {
        let t_ns = (1e9 * (reading.t_s - begin_s)).round().max(0.0) as u64;
        let Ok(filtered) = session.take(t_ns, Inputs::from(reading.inputs)) else {
            reading.inputs = [f64::NAN; MAX_INPUTS];
            continue;
        };
        (reading.inputs, reading.spread) = (*filtered.inputs.values(), filtered.spread);
        let is_open = |(input, sigma): (usize, f64)| {
            reading.spread.get(input).is_some_and(|s| s.iter().sum::<f64>() > FADED_SIGMAS * sigma)
        };
        is_after_gap = (is_after_gap || filtered.is_after_gap()) && setup.measured_inputs().any(is_open);
        if is_after_gap {
            reading.inputs = [f64::NAN; MAX_INPUTS];
        }
    }
}

/// An inertial load: its position in the inputs and its value while the body rests.
#[derive(Debug, Clone, Copy)]
struct RestingLoad {
    input: usize,
    rest: f64,
}

/// Motion of the body along the readings.
#[derive(Debug, Clone)]
pub(super) struct MovingBody {
    motion: ModelMotion,
    /// All inertial loads. The estimation finds the first; the further ones follow the motion.
    loads: Vec<RestingLoad>,
    first_load: RestingLoad,
    /// Instant from which steps begin.
    base: Option<SavedMotion>,
    begin_s: f64,
    /// Motion at the last reading.
    moved: Option<MotionStep>,
    /// Part of the contact force that the equilibrium at the moving load does not have, N; `None` until it is asked for.
    extra_n: Option<f64>,
}

impl MovingBody {
    /// `None` for a model without inertia.
    pub(super) fn new(model: &Model) -> Result<Option<Self>, String> {
        let Some(mut motion) = ModelMotion::new(model).map_err(|error| format!("model: {error}"))? else {
            return Ok(None);
        };
        let rest =
            |input: usize| model.header.inputs.get(input).and_then(|input| input.value).unwrap_or(f64::NAN);
        let loads: Vec<RestingLoad> =
            motion.load_inputs().into_iter().map(|input| RestingLoad { input, rest: rest(input) }).collect();
        let Some(first_load) = loads.first().copied() else { return Ok(None) };
        Ok(Some(Self {
            motion,
            loads,
            first_load,
            base: None,
            begin_s: f64::NAN,
            moved: None,
            extra_n: None,
        }))
    }

    /// Inputs with the further loads of the motion at its last step: they follow it.
    pub(super) fn with_further_loads(&self, inputs: Inputs) -> Inputs {
        let Some(moved) = &self.moved else { return inputs };
        let further = self.loads.iter().skip(1);
        let value = |input: usize| moved.state.inputs.values().get(input).copied();
        further.fold(inputs, |inputs, load| inputs.with(load.input, value(load.input).unwrap_or(load.rest)))
    }

    /// Amplitudes of the linear modes at the last step, where the regime is that of the motion.
    pub(super) fn modes_of(&self, kind: RegimeKind) -> Option<&MotionStep> {
        self.moved.as_ref().filter(|moved| moved.state.regime == kind)
    }

    /// Evaluates the motion at the last reading. `None` before the first.
    pub(super) fn evaluate(&mut self, out: &mut Evaluation) -> Option<RegimeKind> {
        let moved = self.moved.as_ref()?;
        self.motion.evaluate(moved, out);
        Some(moved.state.regime)
    }

    /// Adds the linear modes to the coefficients of an evaluation in the motion's regime.
    pub(super) fn add_modes(&self, out: &mut Evaluation) {
        if let Some(moved) = self.modes_of(out.regime) {
            self.motion.add_modes(&moved.state, out);
        }
    }

    /// Force that linear modes, damping and relaxation add to that of an equilibrium in contact, N; `of_equilibrium` gives the latter.
    pub(super) fn extra_n(&mut self, of_equilibrium: impl FnOnce(Inputs) -> f64) -> f64 {
        let state = self.modes_of(RegimeKind::Contact).map(|moved| moved.state);
        let Some(state) = state else { return 0.0 };
        *self.extra_n.get_or_insert_with(|| {
            let extra_n = state.contact_force_n - of_equilibrium(state.inputs);
            if extra_n.is_finite() { extra_n } else { 0.0 }
        })
    }

    fn ns(&self, t_s: f64) -> u64 {
        ((t_s - self.begin_s) * 1e9).round().max(0.0) as u64
    }

    /// Inputs with the loads at rest.
    fn at_rest(&self, inputs: &[f64; MAX_INPUTS]) -> Inputs {
        self.loads.iter().fold(Inputs::from(*inputs), |inputs, load| inputs.with(load.input, load.rest))
    }

    pub(super) fn step(
        &mut self,
        from: &MotionState,
        t_s: f64,
        inputs: &[f64; MAX_INPUTS],
    ) -> Option<MotionEnd> {
        let end = self.at_rest(inputs);
        if !end.pressure_mpa().is_finite() || end.gap_mm().is_nan() {
            return None;
        }
        let (base, load) = (self.base?, *from.inputs.get(self.first_load.input)?);
        let (start, t_ns) = (self.at_rest(&from.inputs), self.ns(t_s));
        let stepper = self.motion.stepper();
        stepper.restore(&base);
        let before = stepper.regime()?;
        // What is not known to be there is not left.
        let regime = if start.values().get(GAP).is_some_and(|gap| gap.is_infinite()) {
            RegimeKind::Free
        } else {
            before
        };
        stepper.set(regime, &start, [load, from.rate])?;
        let MotionArrival { moved, has_changed } = stepper.arrive(t_ns, &end, STEP_NS);
        let [load, rate] = stepper.swing()?;
        (self.moved, self.extra_n) = (Some(moved), None);
        (!moved.at_rest).then_some(MotionEnd { load, rate, has_changed })
    }

    pub(super) fn settle(&mut self, state: &MotionState, in_contact: bool) {
        let inputs = self.at_rest(&state.inputs);
        if self.base.is_none() {
            self.begin_s = state.t_s;
        }
        let t_ns = self.ns(state.t_s);
        let stepper = self.motion.stepper();
        let mut moved = match self.moved.filter(|_| stepper.last_ns() == Some(t_ns)) {
            Some(moved) => moved,
            None => {
                stepper.reset();
                stepper.arrive(t_ns, &inputs, STEP_NS).moved
            }
        };
        let load = state.inputs.get(self.first_load.input).copied().unwrap_or(self.first_load.rest);
        let can_touch = in_contact && inputs.gap_mm().is_finite();
        let regime = if can_touch { RegimeKind::Contact } else { RegimeKind::Free };
        if let Some(body_state) = stepper.set(regime, &inputs, [load, state.rate]) {
            moved.state = body_state;
        }
        self.base = Some(stepper.keep());
        (self.moved, self.extra_n) = (Some(moved), None);
    }
}
