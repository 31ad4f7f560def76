//! The estimator of an actuator: the scene's unknowns and sensors, the model's predictions of what they measure: the force, markers, observables.

use crate::config::{ActuatorSpec, BIASES, CameraSpec, Gap, PRESSURE_BIAS, Sigmas};
use crate::measured::MeasuredInputs;
use estimate::{
    Alarm, Filter, InputRole, MAX_INPUTS, Measurement, Predicted, Row, Setup, Status, Unknown, Update,
};
use rom::evaluation::Evaluation;
use rom::evaluator::Evaluator;
use rom::inputs::{GAP, InputSpec, Inputs, PRESSURE};
use rom::memory::{Advance, Memory, MemorySpec};
use rom::model::{Model, ModelError};
use rom::observable::Observables;
use rom::probe::{ProbePosition, Probes};
use rom::regime::LastOnset;
use rom::snapshots::{FieldKind, RegimeKind};
use wire::layout::{MARKERS_MAX, Marker, PARAMETERS_MAX, estimate_alarm, estimate_status, set_slot};
use wire::{Estimate, SensorSample};

/// Standard deviations of a normal distribution within the model's half-widths, which hold for 90 % of the states.
pub(crate) const HALFWIDTH_SIGMAS: f64 = 1.645;
/// Most that a bias may be, far beyond what any sensor has.
const MAX_BIAS: f64 = 1e3;

/// Setup of the estimator.
///
/// # Errors
/// All problems of the scene with this model.
pub fn setup(spec: &ActuatorSpec, model: &Model) -> Result<Setup, Vec<String>> {
    let inputs = &model.header.inputs;
    let sigmas = spec.sigmas();
    let keys: Vec<String> = inputs.iter().map(InputSpec::key).collect();
    let names: Vec<&str> = keys.iter().map(String::as_str).chain(BIASES).collect();
    let mut problems: Vec<String> = Vec::new();
    for name in spec.estimate.keys().filter(|name| !names.contains(&name.as_str())) {
        problems
            .push(format!("estimate.{name}: expected one of {}, found no such quantity", names.join(", ")));
    }
    if spec.estimate.contains_key("pressure_mpa") {
        problems.push("estimate.pressure_mpa: the pressure is measured; estimate `pressure_bias_mpa`".into());
    }
    let estimated: Vec<&str> =
        names.iter().copied().filter(|name| spec.estimate.contains_key(*name)).collect();
    let position = |name: &str| estimated.iter().position(|other| *other == name);
    let range = |name: &str| match keys.iter().position(|key| key == name) {
        Some(GAP) => [0.0, MAX_BIAS],
        Some(input) => inputs.get(input).map_or([-MAX_BIAS, MAX_BIAS], |input| input.range),
        None => [-MAX_BIAS, MAX_BIAS],
    };
    // Inputs with memory whose past is unknown.
    let remembering = match MemorySpec::of(model) {
        Ok(found) => found.map_or_else(Vec::new, |spec| spec.inputs.iter().map(|of| of.input).collect()),
        Err(error) => {
            problems.push(format!("model: {error}"));
            Vec::new()
        }
    };
    let past = |input: usize| {
        let at = remembering.iter().position(|other| *other == input);
        at.map(|at| estimated.len() + at)
    };
    let pasts = remembering.iter().filter_map(|input| {
        let name = format!("{}_past", inputs.get(*input)?.name);
        Some(Unknown { name, prior: 0.0, sigma: 1.0, drift_per_sqrt_s: 0.0, range: [-1.0, 1.0] })
    });
    let unknowns = estimated.iter().filter_map(|name| {
        let unknown = spec.estimate.get(*name)?;
        Some(Unknown {
            name: (*name).into(),
            prior: unknown.prior,
            sigma: unknown.sigma,
            drift_per_sqrt_s: unknown.drift,
            range: range(name),
        })
    });
    let is_measured = |key: &str| spec.inputs.get(key).is_some_and(|from| from.measured().is_some());
    for key in keys.iter().filter(|key| is_measured(key) && spec.named_sigma(key).is_none()) {
        problems.push(format!(
            "inputs.\"{key}\": expected the standard deviation of its readings for the estimation, `sigma` of its sensor or \
             {{ sigma = ... }} here; found none"
        ));
    }
    let needs = model.header.needs();
    let role = |(input, key): (usize, &String)| match (input, position(key), spec.gap_mm) {
        (PRESSURE, ..) if !needs.pressure => InputRole::Given(0.0),
        (PRESSURE, ..) => InputRole::Measured {
            sigma: sigmas.pressure_mpa,
            bias: position(PRESSURE_BIAS),
            rate_change: spec.sigma.pressure_rate_mpa_per_s,
            past: past(PRESSURE),
        },
        (_, Some(unknown), _) => InputRole::Estimated(unknown),
        (GAP, None, Gap::Fixed(gap_mm)) => InputRole::Given(gap_mm),
        (GAP, None, _) if !needs.gap => InputRole::Given(f64::INFINITY),
        (GAP, None, _) => {
            InputRole::Measured { sigma: sigmas.gap_mm, bias: None, rate_change: None, past: past(GAP) }
        }
        _ if is_measured(key) => {
            let sigma = spec.named_sigma(key).unwrap_or(f64::NAN);
            InputRole::Measured { sigma, bias: None, rate_change: None, past: past(input) }
        }
        _ => InputRole::Given(inputs.get(input).and_then(|input| input.value).unwrap_or(f64::NAN)),
    };
    let observed = Observed::new(spec, model).unwrap_or_else(|found| {
        problems.extend(found);
        None
    });
    let out = Setup {
        unknowns: unknowns.chain(pasts).collect(),
        inputs: keys.iter().enumerate().map(role).collect(),
        rows: rows(spec, model, position("force_bias_n"), &sigmas, observed),
        gap: Some(GAP),
        model_correlation_s: spec.sigma.model_correlation_s,
    };
    if let Err(errors) = out.check() {
        problems.extend(errors.iter().map(|error| format!("estimate: {error}")));
    }
    if problems.is_empty() { Ok(out) } else { Err(problems) }
}

/// The force, then x, y, z of each marker, then the observables.
fn rows(
    spec: &ActuatorSpec,
    model: &Model,
    force_bias: Option<usize>,
    sigmas: &Sigmas,
    observed: Option<Observed>,
) -> Vec<Row> {
    let regimes = model.header.regimes.iter();
    let (force, displacement) = regimes.fold((0.0_f64, 0.0_f64), |(force, displacement), regime| {
        (force.max(regime.halfwidths.force_n), displacement.max(regime.halfwidths.displacement_mm))
    });
    let force = Row {
        name: "measured_force_n".into(),
        block: 0,
        sigma: sigmas.force_n,
        model_sigma: spec.sigma.model_force_n.unwrap_or(force / HALFWIDTH_SIGMAS),
        bias: force_bias,
    };
    let marker = |(at, marker): (usize, &crate::config::MarkerSpec)| {
        let Marker { x, y, z } = sigmas.markers_mm.get(at).copied().unwrap_or(Marker::ABSENT);
        [("x", x), ("y", y), ("z", z)].map(|(axis, sigma)| Row {
            name: format!("{} {axis}", marker.name),
            block: at + 1,
            sigma,
            model_sigma: spec.sigma.model_mm.unwrap_or(displacement / HALFWIDTH_SIGMAS),
            bias: None,
        })
    };
    let mut observed = observed;
    let observable = |(at, (name, of)): (usize, (&String, &crate::config::ObservedSpec))| {
        let width = observed.as_mut().map_or(f64::NAN, |observed| observed.largest_halfwidth(at, model));
        Row {
            name: name.clone(),
            block: spec.markers.len() + 1 + at,
            sigma: spec.named_sigma(name).unwrap_or(f64::NAN),
            model_sigma: of.model_sigma.unwrap_or(width / HALFWIDTH_SIGMAS),
            bias: None,
        }
    };
    let markers = spec.markers.iter().enumerate().flat_map(marker);
    std::iter::once(force).chain(markers).chain(spec.observables.iter().enumerate().map(observable)).collect()
}

/// The measured observables of a scene with the whole coefficients that they are computed of.
#[derive(Debug, Clone)]
struct Observed {
    evaluator: Evaluator,
    evaluation: Evaluation,
    observables: Observables,
    /// Positions of the measured ones, in the order of the scene.
    which: Vec<usize>,
}

impl Observed {
    /// `None` if the scene measures no observable.
    ///
    /// # Errors
    /// Observables that the model does not have.
    fn new(spec: &ActuatorSpec, model: &Model) -> Result<Option<Self>, Vec<String>> {
        if spec.observables.is_empty() {
            return Ok(None);
        }
        let fail = |error: &dyn std::fmt::Display| vec![format!("model: {error}")];
        let observables = Observables::of(model).map_err(|error| fail(&error))?;
        let known: Vec<&str> = observables.names().collect();
        let (mut which, mut problems) = (Vec::new(), Vec::new());
        for name in spec.observables.keys() {
            match known.iter().position(|known| known == name) {
                Some(at) => which.push(at),
                None => problems.push(format!(
                    "observables.{name}: expected an observable of the model ({}), found no such quantity",
                    known.join(", ")
                )),
            }
        }
        if !problems.is_empty() {
            return Err(problems);
        }
        let mut evaluator = Evaluator::new(&model.header).map_err(|error: ModelError| fail(&error))?;
        let fields = model.header.fields.iter().enumerate();
        let coordinates = fields.filter(|(_, field)| matches!(field.spec.kind, FieldKind::Coordinate(_)));
        evaluator.restrict(&coordinates.map(|(at, _)| at).collect::<Vec<_>>());
        Ok(Some(Self { evaluation: evaluator.evaluation(), evaluator, observables, which }))
    }

    /// The largest half-width of one along the ranges of the inputs.
    fn largest_halfwidth(&mut self, at: usize, model: &Model) -> f64 {
        let inputs = &model.header.inputs;
        let value = |spec: &InputSpec, part: f64| spec.range[0] + part * (spec.range[1] - spec.range[0]);
        let state = |part: f64| {
            let start = Inputs::new(f64::NAN, f64::INFINITY);
            let ranged =
                inputs.iter().enumerate().filter(|(_, spec)| spec.range.iter().all(|end| end.is_finite()));
            ranged.fold(start, |state, (at, spec)| state.with(at, value(spec, part)))
        };
        let mut largest = 0.0_f64;
        for part in [0.0, 0.25, 0.5, 0.75, 1.0] {
            self.evaluator.evaluate(state(part), &mut self.evaluation);
            let width = self.which.get(at).map(|at| self.observables.value(*at, &self.evaluation).halfwidth);
            largest = largest.max(width.filter(|width| width.is_finite()).unwrap_or(0.0));
        }
        largest
    }

    /// Values and derivatives at the last evaluated state.
    fn read(&self, out: &mut [Predicted]) {
        for (to, at) in out.iter_mut().zip(&self.which) {
            to.value = self.observables.value(*at, &self.evaluation).value;
            to.gradient = self.observables.gradient(*at, &self.evaluation);
        }
    }
}

/// The model's predictions of what the sensors measure.
#[derive(Debug, Clone)]
pub struct SensorModel {
    evaluation: Evaluation,
    onset: LastOnset,
    probes: Probes,
    positions: Vec<ProbePosition>,
    camera: CameraSpec,
    rotation: [[f64; 3]; 3],
    observed: Option<Observed>,
}

impl SensorModel {
    /// Takes what it needs from a model: its small part, the modes at the markers, the observables.
    ///
    /// # Errors
    /// All problems of the markers and observables with this model.
    pub fn new(spec: &ActuatorSpec, model: &Model) -> Result<Self, Vec<String>> {
        let (mut points, mut problems) = (Vec::new(), Vec::new());
        for (at, marker) in spec.markers.iter().enumerate() {
            match marker.point(model) {
                Ok(point) => points.push(point),
                Err(error) => problems.push(format!("marker[{at}] `{}`: {error}", marker.name)),
            }
        }
        if !problems.is_empty() {
            return Err(problems);
        }
        let fail = |error: ModelError| vec![format!("model: {error}")];
        let probes = Probes::new(model, &points).map_err(fail)?;
        Ok(Self {
            evaluation: probes.evaluation(),
            onset: LastOnset::default(),
            positions: vec![ProbePosition::default(); points.len()],
            probes,
            camera: spec.camera,
            rotation: spec.camera.rotation(),
            observed: Observed::new(spec, model)?,
        })
    }

    /// False if the model was not trained on forces: a load cell then measures nothing that it explains.
    fn has_forces(&self) -> bool {
        !self.evaluation.flags.no_force
    }

    /// Predicted sensor values at the last evaluated state.
    fn read(&self, out: &mut [Predicted]) {
        let force =
            Predicted { value: self.evaluation.contact_force_n, gradient: self.evaluation.force_gradient };
        let Some((of_force, others)) = out.split_first_mut() else { return };
        *of_force = force;
        let (of_markers, of_observables) = others.split_at_mut(others.len().min(3 * self.positions.len()));
        if let Some(observed) = &self.observed {
            observed.read(of_observables);
        }
        // Into the camera's frame: the transposed rotation of the difference.
        for (coordinates, probe) in of_markers.chunks_exact_mut(3).zip(&self.positions) {
            for (axis, predicted) in coordinates.iter_mut().enumerate() {
                *predicted = Predicted::default();
                let ways =
                    probe.position_mm.iter().zip(self.camera.position_mm).map(|(x, origin)| x - origin);
                for ((row, way), by) in self.rotation.iter().zip(ways).zip(&probe.gradient) {
                    let factor = row.get(axis).copied().unwrap_or(0.0);
                    predicted.value += factor * way;
                    predicted.gradient.iter_mut().zip(by).for_each(|(to, from)| *to += factor * from);
                }
            }
        }
    }
}

impl estimate::Model for SensorModel {
    fn predict(&mut self, inputs: &[f64; MAX_INPUTS], out: &mut [Predicted]) -> bool {
        let inputs = Inputs::from(*inputs);
        self.probes.evaluate_near(inputs, &mut self.onset, &mut self.evaluation, &mut self.positions);
        if let Some(Observed { evaluator, evaluation, .. }) = &mut self.observed {
            evaluator.differentiate_near(inputs, &mut self.onset, evaluation);
        }
        self.read(out);
        self.evaluation.regime == RegimeKind::Contact
    }

    fn predict_free(&mut self, inputs: &[f64; MAX_INPUTS], out: &mut [Predicted]) {
        self.probes.evaluate_free(Inputs::from(*inputs), &mut self.evaluation, &mut self.positions);
        if let Some(Observed { evaluator, evaluation, .. }) = &mut self.observed {
            evaluator.differentiate_free(Inputs::from(*inputs), evaluation);
        }
        self.read(out);
    }

    fn onset_gap_mm(&mut self, inputs: &[f64; MAX_INPUTS]) -> Option<f64> {
        self.probes.closed_gap_mm(Inputs::from(*inputs), &mut self.evaluation)
    }

    fn inside_contact_mm(&self, inputs: &[f64; MAX_INPUTS]) -> Option<f64> {
        self.onset.inside_mm(&Inputs::from(*inputs))
    }
}

/// The filter of one actuator with the model that predicts its sensors.
#[derive(Debug, Clone)]
pub struct Estimator {
    filter: Filter,
    sensors: SensorModel,
    values: SensorValues,
    rejected_total: u64,
    used: Used,
}

/// Times of the force, the markers and the named values that were used last, ns: a measurement counts once, although the readings
/// repeat a slow sensor's value.
#[derive(Debug, Clone, Default)]
pub(crate) struct Used {
    force_ns: u64,
    markers_ns: [u64; MARKERS_MAX],
    named_ns: [u64; PARAMETERS_MAX],
}

/// Values of a reading that were not used before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct New {
    pub(crate) force: bool,
    pub(crate) markers: [bool; MARKERS_MAX],
    pub(crate) named: [bool; PARAMETERS_MAX],
}

impl Used {
    /// Values that are new in this reading; they count as used from now on. Without ages all are new.
    pub(crate) fn new_in(&mut self, sample: &SensorSample) -> New {
        let mut new = New::ALL;
        if sample.age_count == 0 {
            return new;
        }
        let is_new = |age_ns: u64, used_ns: &mut u64| {
            let taken_ns = sample.t_sensor_ns.saturating_sub(age_ns);
            let is_new = taken_ns > *used_ns;
            *used_ns = taken_ns.max(*used_ns);
            is_new
        };
        new.force = is_new(sample.ages_ns.force, &mut self.force_ns);
        let markers = sample.ages_ns.markers.iter().zip(&mut self.markers_ns);
        for (new, (age_ns, used_ns)) in new.markers.iter_mut().zip(markers) {
            *new = is_new(*age_ns, used_ns);
        }
        let named = sample.input_ages_ns.iter().zip(&mut self.named_ns);
        for (new, (age_ns, used_ns)) in new.named.iter_mut().zip(named) {
            *new = is_new(*age_ns, used_ns);
        }
        new
    }
}

impl Estimator {
    /// Starts from the scene's priors; none when the scene estimates nothing.
    ///
    /// # Errors
    /// All problems of the scene with this model.
    pub fn new(spec: &ActuatorSpec, model: &Model) -> Result<Option<Self>, Vec<String>> {
        if spec.estimate.is_empty() {
            return Ok(None);
        }
        let (setup, sensors) = match (setup(spec, model), SensorModel::new(spec, model)) {
            (Ok(setup), Ok(sensors)) => (setup, sensors),
            (setup, sensors) => {
                return Err([setup.err(), sensors.err()].into_iter().flatten().flatten().collect());
            }
        };
        let filter = Filter::new(setup)
            .map_err(|errors| errors.iter().map(|error| format!("estimate: {error}")).collect::<Vec<_>>())?;
        Ok(Some(Self {
            filter,
            sensors,
            values: SensorValues::new(spec),
            rejected_total: 0,
            used: Used::default(),
        }))
    }

    /// Takes a reading into account; allocates nothing.
    /// `inputs`: the model's inputs in it, behind the memory; `spread`: their largest error by its past.
    pub(crate) fn update(
        &mut self,
        sample: &SensorSample,
        inputs: &Inputs,
        spread: [f64; MAX_INPUTS],
    ) -> Update {
        let new = self.used.new_in(sample);
        let mut measurement =
            self.values.of(sample.t_sensor_ns as f64 * 1e-9, sample, *inputs.values(), &new);
        if !self.sensors.has_forces() {
            measurement.rows[0] = f64::NAN;
        }
        measurement.spread = spread;
        let update = self.filter.update(&measurement, &mut self.sensors);
        self.rejected_total += u64::from(update.rejected.count_ones());
        update
    }

    /// The memory has another past, which is unknown.
    pub(crate) fn forget_past(&mut self) {
        self.filter.forget_past();
    }

    /// Standard deviation of the force at an evaluation, N.
    pub(crate) fn force_sigma_n(&self, evaluation: &Evaluation) -> f64 {
        self.filter.sigma_of(&evaluation.force_gradient)
    }

    /// Estimated bias of the load cell, N; 0 if it is not estimated.
    pub(crate) fn force_bias_n(&self) -> f64 {
        let bias = self.filter.setup().rows.first().and_then(|row| row.bias);
        bias.and_then(|at| self.filter.estimates().nth(at)).map_or(0.0, |estimate| estimate.value)
    }

    /// Writes estimates and the outcome of the last reading.
    pub(crate) fn fill(&self, update: &Update, out: &mut Estimate) {
        let mut identifiable = 0;
        let slots = out.values.iter_mut().zip(&mut out.sigmas).enumerate();
        for (estimate, (at, (value, sigma))) in self.filter.estimates().zip(slots) {
            (*value, *sigma) = (estimate.value, estimate.sigma);
            identifiable |= u32::from(estimate.identifiable) << at;
        }
        out.identifiable = identifiable;
        out.status = match update.status {
            Status::Used if update.converged => estimate_status::USED,
            Status::Used => estimate_status::TANGENT,
            Status::InputMissing => estimate_status::INPUT_MISSING,
            Status::NotLater => estimate_status::NOT_LATER,
            Status::NotConverged => estimate_status::NOT_CONVERGED,
            Status::NotExplained => estimate_status::NOT_EXPLAINED,
        };
        (out.alarm, out.suspects) = match update.alarm {
            None => (estimate_alarm::NONE, 0),
            Some(Alarm::Input(which)) => (estimate_alarm::INPUT, which),
            Some(Alarm::Sensor(which)) => (estimate_alarm::SENSOR, which),
            Some(Alarm::Unknown(which)) => (estimate_alarm::QUANTITY, which),
            Some(Alarm::NotExplained) => (estimate_alarm::NOT_EXPLAINED, 0),
        };
        (out.nis, [out.nis_low, out.nis_high]) = (update.nis, update.nis_band);
        (out.used_values, out.rejected) = (update.used as u32, update.rejected);
        out.rejected_total = self.rejected_total;
    }

    /// An estimate with everything that stays the same.
    pub(crate) fn payload(&self) -> Estimate {
        let setup = self.filter.setup();
        let mut out = Estimate {
            unknown_count: setup.unknowns.len() as u32,
            input_count: setup.inputs.len() as u32,
            ..Estimate::default()
        };
        for (at, unknown) in setup.unknowns.iter().enumerate() {
            out.set_name(at, &unknown.name);
        }
        out
    }
}

/// A reading as the estimator takes it; `named`: which inputs it carries by name.
pub fn measurement(
    t_s: f64,
    reading: &SensorSample,
    named: &MeasuredInputs,
    values: &SensorValues,
) -> Measurement {
    let operating = Inputs::new(reading.pressure_mpa, reading.gap_mm);
    let of_inputs = named.of(reading.input_count, &reading.input_names, &reading.inputs);
    let inputs = of_inputs.fold(operating, |inputs, measured| inputs.with(measured.input, measured.value));
    values.of(t_s, reading, *inputs.values(), &New::ALL)
}

/// Effect of an unknown past, in standard deviations of a reading, from which a reading after a gap is used again.
const FADED_SIGMAS: f64 = 0.1;

/// Puts the inputs of readings in the order of their times behind a model's memory. Readings whose past is that of a gap have no inputs
/// until it has faded: only the past before the first reading is an unknown.
pub fn behind(memory: &mut Memory, setup: &Setup, readings: &mut [Measurement]) {
    let begin_s = readings.first().map_or(0.0, |reading| reading.t_s);
    let mut is_after_gap = false;
    for reading in readings {
        let inputs = Inputs::from(reading.inputs);
        let outcome = memory.advance((1e9 * (reading.t_s - begin_s)).round().max(0.0) as u64, &inputs);
        reading.inputs = *memory.effective(&inputs).values();
        reading.spread = memory.spread();
        let is_open = |(input, sigma): (usize, f64)| {
            reading.spread.get(input).is_some_and(|s| *s > FADED_SIGMAS * sigma)
        };
        is_after_gap = (is_after_gap || outcome == Advance::Gap) && setup.measured_inputs().any(is_open);
        if is_after_gap || outcome == Advance::NotFinite {
            reading.inputs = [f64::NAN; MAX_INPUTS];
        }
    }
}

impl New {
    pub(crate) const ALL: Self =
        Self { force: true, markers: [true; MARKERS_MAX], named: [true; PARAMETERS_MAX] };
}

/// Values of a reading in the order of the rows of [`setup`]: the force, x, y, z of each marker, the observables.
#[derive(Debug, Clone)]
pub struct SensorValues {
    markers: usize,
    /// Names of the observables as readings carry them.
    observables: Vec<[u8; 32]>,
}

impl SensorValues {
    /// Those of a scene's actuator.
    pub fn new(spec: &ActuatorSpec) -> Self {
        let packed = |name: &String| {
            let mut packed = [0; 32];
            set_slot(&mut packed, 0, name);
            packed
        };
        Self { markers: spec.markers.len(), observables: spec.observables.keys().map(packed).collect() }
    }

    fn of(&self, t_s: f64, reading: &SensorSample, inputs: [f64; MAX_INPUTS], new: &New) -> Measurement {
        let mut out = Measurement::at(t_s);
        out.inputs = inputs;
        let force_n = if new.force { reading.measured_force_n } else { f64::NAN };
        let markers = reading.markers_mm.iter().zip(new.markers).enumerate().map(|(at, (marker, is_new))| {
            if is_new && at < reading.marker_values as usize / 3 { *marker } else { Marker::ABSENT }
        });
        let coordinates = markers.take(self.markers).flat_map(|marker| [marker.x, marker.y, marker.z]);
        let names = reading.input_names.as_chunks::<32>().0;
        let named = || names.iter().zip(&reading.inputs).zip(new.named).take(reading.input_count as usize);
        let observable = |name: &[u8; 32]| {
            let found = named().find(|((known, _), is_new)| *known == name && *is_new);
            found.map_or(f64::NAN, |((_, value), _)| *value)
        };
        let all = std::iter::once(force_n).chain(coordinates).chain(self.observables.iter().map(observable));
        out.rows.iter_mut().zip(all).for_each(|(to, from)| *to = from);
        out
    }
}

#[cfg(test)]
#[path = "../tests/unit/estimation.rs"]
mod tests;
