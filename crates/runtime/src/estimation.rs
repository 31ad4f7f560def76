//! The estimator of an actuator: the scene's unknowns and sensors, the model's predictions of what they measure: the force, markers, observables.

#[expect(
    clippy::indexing_slicing,
    reason = "made before measuring, outside the services, from lists of its own"
)]
pub mod experiment;
mod learned;
mod moving;
mod observed;

pub use learned::{FollowedOutputs, LearnedMarkers, MarkerModel};
pub use moving::filter;

use crate::config::{ActuatorSpec, BIASES, CameraSpec, FORCE_BIAS, Gap, PRESSURE_BIAS, Sigmas};
use crate::measured::MeasuredInputs;
use estimate::{
    Alarm, Filter, InputRole, MAX_INPUTS, MeasuredRow, Measurement, MotionEnd, MotionState, PASTS, Predicted,
    Setup, Status, Swing, Unknown, Update,
};
use moving::MovingBody;
use observed::Observed;
pub(crate) use observed::measured_observables;
use rom::evaluation::Evaluation;
use rom::evaluator::Query;
use rom::halfwidths::HALFWIDTH_SIGMAS;
use rom::inputs::{GAP, InputSpec, Inputs, PRESSURE};
use rom::model::{Model, ModelError};
use rom::probe::{ProbePosition, Probes};
use rom::regime::LastOnset;
use rom::snapshots::RegimeKind;
use wire::layout::{
    MARKERS_MAX, Marker, PARAMETERS_MAX, UNKNOWNS_MAX, estimate_alarm, estimate_status, pack_slot,
};
use wire::{Estimate, SensorSample};

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
    let mut problems = wrong_names(spec, &keys, &names);
    let estimated: Vec<&str> =
        names.iter().copied().filter(|name| spec.estimate.contains_key(*name)).collect();
    let position = |name: &str| estimated.iter().position(|other| *other == name);
    let range = |name: &str| match keys.iter().position(|key| key == name) {
        Some(GAP) => [0.0, MAX_BIAS],
        Some(input) => inputs.get(input).map_or([-MAX_BIAS, MAX_BIAS], |input| input.range),
        None => [-MAX_BIAS, MAX_BIAS],
    };
    let remembered = moving::remembered_inputs(model).unwrap_or_else(|error| {
        problems.push(error);
        Vec::new()
    });
    let swing = moving::unknown_swing(model).unwrap_or_else(|error| {
        problems.push(error);
        None
    });
    let past = |input: usize| moving::past_positions(input, &remembered, estimated.len());
    let pasts = moving::unknown_pasts(inputs, &remembered);
    let load = estimated.len() + pasts.len();
    let unknowns = estimated.iter().filter_map(|name| {
        let unknown = spec.estimate.get(*name)?;
        Some(Unknown {
            name: (*name).into(),
            prior: unknown.prior,
            sigma: unknown.sigma,
            drift_per_sqrt_s: unknown.drift_of(name),
            range: range(name),
        })
    });
    let is_measured = |key: &str| is_measured(spec, key);
    let load_input = swing.as_ref().map(|swing| swing.input);
    if let Some(key) = load_input.and_then(|input| keys.get(input))
        && (is_measured(key) || position(key).is_some())
    {
        problems.push(format!(
            "{key}: expected a constant load at rest, because the estimation steps the moving load of this model; found it \
             measured or under `estimate`"
        ));
    }
    let needs = model.header.needs();
    let role = |(input, key): (usize, &String)| match (input, position(key), spec.gap_mm) {
        (input, ..) if load_input == Some(input) => InputRole::Estimated(load),
        (PRESSURE, ..) if !needs.pressure => InputRole::Given(0.0),
        (PRESSURE, ..) => InputRole::Measured {
            sigma: sigmas.pressure_mpa,
            bias: position(PRESSURE_BIAS),
            rate_change: spec.sigma.pressure_rate_mpa_per_s,
            pasts: past(PRESSURE),
        },
        (_, Some(unknown), _) => InputRole::Estimated(unknown),
        (GAP, None, Gap::Fixed(gap_mm)) => InputRole::Given(gap_mm),
        (GAP, None, _) if !needs.gap => InputRole::Given(f64::INFINITY),
        (GAP, None, _) => {
            InputRole::Measured { sigma: sigmas.gap_mm, bias: None, rate_change: None, pasts: past(GAP) }
        }
        _ if is_measured(key) => {
            let sigma = spec.named_sigma(key).unwrap_or(f64::NAN);
            InputRole::Measured { sigma, bias: None, rate_change: None, pasts: past(input) }
        }
        _ => InputRole::Given(inputs.get(input).and_then(|input| input.value).unwrap_or(f64::NAN)),
    };
    let observed = Observed::new(spec, model).unwrap_or_else(|found| {
        problems.extend(found);
        None
    });
    let swing_error = swing.as_ref().map(|swing| swing.frequency_error);
    let of_swing = swing.into_iter().flat_map(|swing| swing.unknowns);
    let out = Setup {
        unknowns: unknowns.chain(pasts).chain(of_swing).collect(),
        inputs: keys.iter().enumerate().map(role).collect(),
        rows: rows(spec, model, position(FORCE_BIAS), &sigmas, observed),
        gap: Some(GAP),
        model_correlation_s: spec.sigma.model_correlation_s,
        alarm_hold_s: spec.sigma.alarm_hold_s,
        swing: swing_error.map(|frequency_error| Swing { load, rate: load + 1, frequency_error }),
    };
    problems.extend(wrong_setup(&out));
    if problems.is_empty() { Ok(out) } else { Err(problems) }
}

fn is_measured(spec: &ActuatorSpec, key: &str) -> bool {
    spec.inputs.get(key).is_some_and(|from| from.measured().is_some())
}

/// What a scene names that the model does not have, and inputs without the scatter of their readings.
fn wrong_names(spec: &ActuatorSpec, keys: &[String], names: &[&str]) -> Vec<String> {
    let mut problems: Vec<String> = Vec::new();
    for name in spec.estimate.keys().filter(|name| !names.contains(&name.as_str())) {
        problems
            .push(format!("estimate.{name}: expected one of {}, found no such quantity", names.join(", ")));
    }
    if spec.estimate.contains_key("pressure_mpa") {
        problems.push("estimate.pressure_mpa: the pressure is measured; estimate `pressure_bias_mpa`".into());
    }
    for key in keys.iter().filter(|key| is_measured(spec, key) && spec.named_sigma(key).is_none()) {
        problems.push(format!(
            "inputs.\"{key}\": expected the standard deviation of its readings for the estimation, `sigma` of its sensor or \
             {{ sigma = ... }} here; found none"
        ));
    }
    problems
}

fn wrong_setup(out: &Setup) -> Vec<String> {
    let mut problems = Vec::new();
    if out.unknowns.len() > UNKNOWNS_MAX {
        let names: Vec<&str> = out.unknowns.iter().map(|unknown| unknown.name.as_str()).collect();
        problems.push(format!(
            "estimate: expected at most {UNKNOWNS_MAX} unknowns with those of memory and motion, found {} ({})",
            names.len(),
            names.join(", ")
        ));
    }
    if let Err(errors) = out.check() {
        problems.extend(errors.iter().map(|error| format!("estimate: {error}")));
    }
    problems
}

/// Error that the mesh of a finite-element model leaves after a fit, as a part of the largest force and of a marker's travel.
const MESH_FORCE: f64 = 0.01;
const MESH_TRAVEL: f64 = 0.001;

/// Errors of the mesh. 0 for a model learned from measurements, which has none.
#[derive(Debug, Clone, Copy, Default)]
struct MeshErrors {
    force_n: f64,
    /// Of the markers.
    marker_mm: f64,
}

/// A model does not know its mesh's error. These are the parts by which finer meshes of the shipped fingers change force and position, of
/// the force and the travel along the pressures at the gap and the inputs of the scene.
fn mesh_errors(spec: &ActuatorSpec, model: &Model) -> MeshErrors {
    let points: Option<Vec<_>> = spec.markers.iter().map(|marker| marker.point(model).ok()).collect();
    let probes = points.and_then(|points| Probes::new(model, &points).ok());
    let Some(probes) = probes.filter(|_| model.header.learned.is_none()) else {
        return MeshErrors::default();
    };
    let value = |(index, input): (usize, &InputSpec)| {
        let given = match spec.gap_mm {
            Gap::Fixed(gap_mm) if index == GAP => Some(gap_mm),
            _ => input.value,
        };
        let prior = spec.estimate.get(&input.key()).map(|unknown| unknown.prior);
        prior.or(given).unwrap_or(0.5 * (input.range[0] + input.range[1]))
    };
    let absent = Inputs::new(f64::NAN, f64::INFINITY);
    let inputs = model.header.inputs.iter().enumerate();
    let nominal = inputs.fold(absent, |inputs, (at, input)| inputs.with(at, value((at, input))));
    let [low, high] = model.header.inputs.first().map_or([0.0; 2], |pressure| pressure.range);
    let mut evaluation = probes.evaluation();
    let mut positions = vec![ProbePosition::default(); spec.markers.len()];
    let (mut begin, mut force_n, mut travel_mm) = (None, 0.0_f64, 0.0_f64);
    for part in [0.0, 0.25, 0.5, 0.75, 1.0] {
        let inputs = nominal.with(PRESSURE, low + part * (high - low));
        probes.answer(inputs, Query { range: false, ..Query::GRADIENTS }, &mut evaluation, &mut positions);
        force_n = force_n.max(evaluation.contact_force_n);
        let begin = begin.get_or_insert_with(|| positions.clone());
        for (there, begin) in positions.iter().zip(begin) {
            let square = there.position_mm.iter().zip(begin.position_mm).map(|(x, x0)| (x - x0).powi(2));
            travel_mm = travel_mm.max(square.sum::<f64>().sqrt());
        }
    }
    MeshErrors { force_n: MESH_FORCE * force_n, marker_mm: MESH_TRAVEL * travel_mm }
}

/// The force, then x, y, z of each marker, then the observables.
fn rows(
    spec: &ActuatorSpec,
    model: &Model,
    force_bias: Option<usize>,
    sigmas: &Sigmas,
    observed: Option<Observed>,
) -> Vec<MeasuredRow> {
    let regimes = model.header.regimes.iter();
    let (force, displacement) = regimes.fold((0.0_f64, 0.0_f64), |(force, displacement), regime| {
        (force.max(regime.halfwidths.force_n), displacement.max(regime.halfwidths.displacement_mm))
    });
    let mesh = mesh_errors(spec, model);
    let force = MeasuredRow {
        name: "measured_force_n".into(),
        block: 0,
        sigma: sigmas.force_n,
        model_sigma: spec.sigma.model_force_n.unwrap_or_else(|| mesh.force_n.hypot(force / HALFWIDTH_SIGMAS)),
        bias: force_bias,
    };
    let model_mm =
        spec.sigma.model_mm.unwrap_or_else(|| mesh.marker_mm.hypot(displacement / HALFWIDTH_SIGMAS));
    let marker = |(index, marker): (usize, &crate::config::MarkerSpec)| {
        let Marker { x, y, z } = sigmas.markers_mm.get(index).copied().unwrap_or(Marker::ABSENT);
        [("x", x), ("y", y), ("z", z)].map(|(axis, sigma)| MeasuredRow {
            name: format!("{} {axis}", marker.name),
            block: index + 1,
            sigma,
            model_sigma: model_mm,
            bias: None,
        })
    };
    let mut observed = observed;
    let observable = |(index, (name, observed_spec)): (usize, (&String, &crate::config::ObservedSpec))| {
        let width = observed.as_mut().map_or(f64::NAN, |observed| observed.largest_halfwidth(index, model));
        MeasuredRow {
            name: name.clone(),
            block: spec.markers.len() + 1 + index,
            sigma: spec.named_sigma(name).unwrap_or(f64::NAN),
            model_sigma: observed_spec.model_sigma.unwrap_or(width / HALFWIDTH_SIGMAS),
            bias: None,
        }
    };
    let markers = spec.markers.iter().enumerate().flat_map(marker);
    std::iter::once(force).chain(markers).chain(spec.observables.iter().enumerate().map(observable)).collect()
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
    body: Option<MovingBody>,
}

impl SensorModel {
    /// Takes what it needs from a model: its small part, the modes at the markers, the observables.
    ///
    /// # Errors
    /// All problems of the markers and observables with this model.
    pub fn new(spec: &ActuatorSpec, model: &Model) -> Result<Self, Vec<String>> {
        let (mut points, mut problems) = (Vec::new(), Vec::new());
        for (index, marker) in spec.markers.iter().enumerate() {
            match marker.point(model) {
                Ok(point) => points.push(point),
                Err(error) => problems.push(format!("marker[{index}] `{}`: {error}", marker.name)),
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
            body: MovingBody::new(model).map_err(|error| vec![error])?,
        })
    }

    /// False if the model was not trained on forces: a load cell then measures nothing that it explains.
    fn has_forces(&self) -> bool {
        !self.evaluation.flags.no_force
    }

    /// Inputs with those loads that follow the motion.
    fn moving(&self, inputs: &[f64; MAX_INPUTS]) -> Inputs {
        let inputs = Inputs::from(*inputs);
        self.body.as_ref().map_or(inputs, |body| body.with_further_loads(inputs))
    }

    /// Force of the moving body in addition to that of the equilibrium at its load, N.
    fn extra_n(&mut self) -> f64 {
        let Self { body, probes, onset, evaluation, positions, .. } = self;
        let Some(body) = body else { return 0.0 };
        body.extra_n(|inputs| {
            probes.answer(inputs, near(onset), evaluation, positions);
            if evaluation.regime == RegimeKind::Contact { evaluation.contact_force_n } else { f64::NAN }
        })
    }

    /// Adds the linear modes of the moving body.
    fn add_modes(&mut self) {
        let Some(body) = &self.body else { return };
        if let Some(moved) = body.modes_of(self.evaluation.regime) {
            self.probes.add_modes(moved.state.regime, &moved.state.amplitudes, &mut self.positions);
        }
        if let Some(observed) = &mut self.observed {
            body.add_modes(&mut observed.evaluation);
        }
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

/// A state of the filter's search, near the last one.
fn near(last: &mut LastOnset) -> Query<'_> {
    Query { range: false, near: Some(last), ..Query::GRADIENTS }
}

/// A state where nothing is there to touch, whatever the gap.
const FREE: Query<'static> = Query { range: false, regime: Some(RegimeKind::Free), ..Query::GRADIENTS };

impl estimate::Model for SensorModel {
    fn predict(&mut self, inputs: &[f64; MAX_INPUTS], out: &mut [Predicted]) -> bool {
        let (extra_n, inputs) = (self.extra_n(), self.moving(inputs));
        self.probes.answer(inputs, near(&mut self.onset), &mut self.evaluation, &mut self.positions);
        if let Some(Observed { evaluator, evaluation, .. }) = &mut self.observed {
            evaluator.answer(inputs, near(&mut self.onset), evaluation);
        }
        self.add_modes();
        self.read(out);
        let is_contact = self.evaluation.regime == RegimeKind::Contact;
        if let Some(force) = out.first_mut().filter(|_| is_contact) {
            force.value += extra_n;
        }
        is_contact
    }

    fn predict_free(&mut self, inputs: &[f64; MAX_INPUTS], out: &mut [Predicted]) {
        let inputs = self.moving(inputs);
        self.probes.answer(inputs, FREE, &mut self.evaluation, &mut self.positions);
        if let Some(Observed { evaluator, evaluation, .. }) = &mut self.observed {
            evaluator.answer(inputs, FREE, evaluation);
        }
        self.add_modes();
        self.read(out);
    }

    fn onset_gap_mm(&mut self, inputs: &[f64; MAX_INPUTS]) -> Option<f64> {
        self.probes.closed_gap_mm(self.moving(inputs), &mut self.evaluation)
    }

    fn inside_contact_mm(&self, inputs: &[f64; MAX_INPUTS]) -> Option<f64> {
        self.onset.inside_mm(&self.moving(inputs))
    }

    fn step(&mut self, from: &MotionState, t_s: f64, inputs: &[f64; MAX_INPUTS]) -> Option<MotionEnd> {
        self.body.as_mut()?.step(from, t_s, inputs)
    }

    fn settle(&mut self, at: &MotionState, in_contact: bool) {
        if let Some(body) = &mut self.body {
            body.settle(at, in_contact);
        }
    }
}

/// The filter of one actuator with the model that predicts its sensors.
#[derive(Debug, Clone)]
pub struct Estimator {
    filter: Filter,
    sensors: SensorModel,
    values: SensorValues,
    rejected_total: u64,
    used: LastUsed,
}

/// Times of the force, the markers and the named values that were used last, ns: a measurement counts once, although the readings
/// repeat a slow sensor's value.
#[derive(Debug, Clone, Default)]
pub(crate) struct LastUsed {
    force_ns: u64,
    markers_ns: [u64; MARKERS_MAX],
    named_ns: [u64; PARAMETERS_MAX],
}

/// Values of a reading that were not used before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct NewValues {
    pub(crate) force: bool,
    pub(crate) markers: [bool; MARKERS_MAX],
    pub(crate) named: [bool; PARAMETERS_MAX],
}

impl LastUsed {
    /// Values that are new in this reading; they count as used from now on. Without ages all are new.
    pub(crate) fn new_in(&mut self, sample: &SensorSample) -> NewValues {
        let mut new = NewValues::ALL;
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
            used: LastUsed::default(),
        }))
    }

    /// Takes a reading into account; allocates nothing.
    /// `inputs`: the model's inputs in it, behind the memory; `spread`: their largest errors by its pasts.
    pub(crate) fn update(
        &mut self,
        sample: &SensorSample,
        inputs: &Inputs,
        spread: [[f64; PASTS]; MAX_INPUTS],
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

    /// Evaluates the moving body that explains the last reading; `None` for a model at equilibrium.
    pub(crate) fn evaluate_motion(&mut self, out: &mut Evaluation) -> Option<RegimeKind> {
        self.sensors.body.as_mut()?.evaluate(out)
    }

    /// Memory and motion have another past, which is unknown.
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
        for (index, unknown) in setup.unknowns.iter().enumerate() {
            out.set_name(index, &unknown.name);
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
    values.of(t_s, reading, *inputs.values(), &NewValues::ALL)
}

impl NewValues {
    pub(crate) const ALL: Self =
        Self { force: true, markers: [true; MARKERS_MAX], named: [true; PARAMETERS_MAX] };
}

/// Names of a model's output that a load cell measures.
const LOAD_CELL_NAMES: [&str; 3] = ["force_n", "contact_force_n", "measured_force_n"];

/// The measured value of a model's observable or output in the readings.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NamedValue {
    /// Name as readings carry it.
    name: [u8; 32],
    /// The load cell's value is meant where a reading has no value of this name.
    is_force: bool,
}

impl NamedValue {
    pub(crate) fn new(name: &str) -> Self {
        Self { name: pack_slot(name), is_force: LOAD_CELL_NAMES.contains(&name) }
    }

    /// Its value in a reading, NaN where there is none; `None` for one that is not new.
    pub(crate) fn new_in(&self, sample: &SensorSample, new: &NewValues) -> Option<f64> {
        let named =
            sample.input(&self.name).map(|(slot, value)| (value, new.named.get(slot) != Some(&false)));
        let of_cell = || self.is_force.then_some((sample.measured_force_n, new.force));
        match named.or_else(of_cell) {
            Some((value, is_new)) => (is_new || value.is_nan()).then_some(value),
            None => Some(f64::NAN),
        }
    }
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
        Self {
            markers: spec.markers.len(),
            observables: spec.observables.keys().map(|name| pack_slot(name)).collect(),
        }
    }

    fn of(
        &self,
        t_s: f64,
        reading: &SensorSample,
        inputs: [f64; MAX_INPUTS],
        new: &NewValues,
    ) -> Measurement {
        let mut out = Measurement::at(t_s);
        out.inputs = inputs;
        let force_n = if new.force { reading.measured_force_n } else { f64::NAN };
        let markers =
            reading.markers_mm.iter().zip(new.markers).enumerate().map(|(index, (marker, is_new))| {
                if is_new && index < reading.marker_values as usize / 3 { *marker } else { Marker::ABSENT }
            });
        let coordinates = markers.take(self.markers).flat_map(|marker| [marker.x, marker.y, marker.z]);
        let observable = |name: &[u8; 32]| {
            let found =
                reading.input(name).filter(|(index, _)| new.named.get(*index).is_some_and(|is_new| *is_new));
            found.map_or(f64::NAN, |(_, value)| value)
        };
        let all = std::iter::once(force_n).chain(coordinates).chain(self.observables.iter().map(observable));
        out.rows.iter_mut().zip(all).for_each(|(to, from)| *to = from);
        out
    }
}

#[cfg(test)]
#[path = "../tests/unit/estimation.rs"]
mod tests;
