//! States that readings do not contain: pasts of the inputs' memory, motion of the body.

use estimate::{MAX_INPUTS, Measurement, MotionEnd, MotionState, PASTS, Setup, Unknown};
use rom::evaluation::Evaluation;
use rom::inertia::model_motion::ModelMotion;
use rom::inertia::stepper::{MotionArrival, MotionStep, SavedMotion};
use rom::inputs::{GAP, InputSpec, Inputs};
use rom::memory::MemorySpec;
use rom::model::Model;
use rom::session::Session;
use rom::snapshots::RegimeKind;

/// Longest inner step, ns: its error is far below that of a reading.
const STEP_NS: u64 = 2_000_000;

/// Inputs of a model whose memory has an unknown past, with those that have one of the creep too.
pub(super) fn remembering(model: &Model) -> Result<Vec<(usize, usize)>, String> {
    let found = MemorySpec::of(model).map_err(|error| format!("model: {error}"))?;
    let of = |of: &rom::memory::InputMemory| (of.input, 1 + usize::from(of.has_two_pasts()));
    Ok(found.map_or_else(Vec::new, |spec| spec.inputs.iter().map(of).collect()))
}

/// Unknowns of these pasts.
pub(super) fn pasts(inputs: &[InputSpec], remembering: &[(usize, usize)]) -> Vec<Unknown> {
    let of = |(input, count): &(usize, usize)| {
        let name = inputs.get(*input).map_or(String::new(), |input| input.name.clone());
        ["past", "creep_past"].into_iter().take(*count).map(move |kind| Unknown {
            name: format!("{name}_{kind}"),
            prior: 0.0,
            sigma: 1.0,
            drift_per_sqrt_s: 0.0,
            range: [-1.0, 1.0],
        })
    };
    remembering.iter().flat_map(of).collect()
}

/// Positions of the pasts of an input in the unknowns, of which `before` come first.
pub(super) fn places(input: usize, remembering: &[(usize, usize)], before: usize) -> [Option<usize>; PASTS] {
    let mut at = before;
    for (other, count) in remembering {
        if *other == input {
            return [Some(at), (*count > 1).then_some(at + 1)];
        }
        at += count;
    }
    [None; PASTS]
}

/// Position of the inertial load in the inputs, unknowns of the swing, relative error of the frequency; `None` for a model without inertia.
pub(super) fn swing(model: &Model) -> Result<Option<(usize, [Unknown; 2], f64)>, String> {
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
    Ok(Some((input, [load, rate], frequency_error)))
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

/// Motion of the body along the readings.
#[derive(Debug, Clone)]
pub(super) struct Body {
    motion: ModelMotion,
    /// Position and value at rest of the first inertial load, and of all.
    load: (usize, f64),
    loads: Vec<(usize, f64)>,
    /// Instant from which steps begin.
    base: Option<SavedMotion>,
    begin_s: f64,
    /// Motion at the last reading.
    moved: Option<MotionStep>,
    /// Part of the contact force that the equilibrium at the moving load does not have, N; `None` until it is asked for.
    extra_n: Option<f64>,
}

impl Body {
    /// `None` for a model without inertia.
    pub(super) fn new(model: &Model) -> Result<Option<Self>, String> {
        let Some(mut motion) = ModelMotion::new(model).map_err(|error| format!("model: {error}"))? else {
            return Ok(None);
        };
        let rest =
            |input: usize| model.header.inputs.get(input).and_then(|input| input.value).unwrap_or(f64::NAN);
        let loads: Vec<(usize, f64)> =
            motion.load_inputs().into_iter().map(|input| (input, rest(input))).collect();
        let Some(load) = loads.first().copied() else { return Ok(None) };
        Ok(Some(Self { motion, load, loads, base: None, begin_s: f64::NAN, moved: None, extra_n: None }))
    }

    /// Inputs with the further loads of the motion at its last step: they follow it.
    pub(super) fn with_further_loads(&self, inputs: Inputs) -> Inputs {
        let Some(moved) = &self.moved else { return inputs };
        let further = self.loads.iter().skip(1);
        let value = |input: usize| moved.state.inputs.values().get(input).copied();
        further.fold(inputs, |inputs, (input, rest)| inputs.with(*input, value(*input).unwrap_or(*rest)))
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
        self.loads.iter().fold(Inputs::from(*inputs), |inputs, (input, rest)| inputs.with(*input, *rest))
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
        let (base, load) = (self.base?, *from.inputs.get(self.load.0)?);
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

    pub(super) fn settle(&mut self, at: &MotionState, in_contact: bool) {
        let inputs = self.at_rest(&at.inputs);
        if self.base.is_none() {
            self.begin_s = at.t_s;
        }
        let t_ns = self.ns(at.t_s);
        let stepper = self.motion.stepper();
        let mut moved = match self.moved.filter(|_| stepper.last_ns() == Some(t_ns)) {
            Some(moved) => moved,
            None => {
                stepper.reset();
                stepper.arrive(t_ns, &inputs, STEP_NS).moved
            }
        };
        let load = at.inputs.get(self.load.0).copied().unwrap_or(self.load.1);
        let can_touch = in_contact && inputs.gap_mm().is_finite();
        let regime = if can_touch { RegimeKind::Contact } else { RegimeKind::Free };
        if let Some(state) = stepper.set(regime, &inputs, [load, at.rate]) {
            moved.state = state;
        }
        self.base = Some(stepper.keep());
        (self.moved, self.extra_n) = (Some(moved), None);
    }
}
