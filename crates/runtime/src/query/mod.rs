//! Answers to queries about a scene's actuators, in a separate thread; the twin's loop is not involved.
//!
//! Every actuator gets a second model in memory: the small part always, the basis only where the scene has
//! `queries = "fields"`.

mod solve;

pub use solve::{NoSolution, Solution, Solver};

use crate::config::{self, ActuatorSpec, ConfigError, Gap, Queries, Scene, StateSpec};
use crate::load::{LoadedActuator, LoadedOutput, PayloadContents, load};
use crate::measured::MeasuredInputs;
use crate::publish;
use crate::side_service::SideService;
use rom::hull::TrainingRange;
use rom::inputs::{GAP, Inputs, Needs, PARAMETERS, PRESSURE};
use rom::model::{ModelHeader, ModelReader};
use rom::snapshots::RegimeKind;
use std::path::Path;
use std::time::{Duration, Instant};
use wire::layout::{pack_name, query_kind, unpack_name};
use wire::{Answer, Bus, Query, QueryServer, QueryStatus, State, WakeSet, Wakeable, WireError};

/// Largest number of queries of one actuator per iteration, so that a flood delays neither the stop flag nor other actuators.
const MAX_BATCH: usize = 64;

/// One actuator's model, ready to answer.
#[derive(Debug)]
pub struct Answerer {
    name: String,
    model_hash: [u8; 16],
    solver: Solver,
    /// Default gap; `None` if every query must name one.
    default_gap_mm: Option<f64>,
    /// Default pressure: any value if the model does not depend on it; otherwise `None`.
    default_pressure_mpa: Option<f64>,
    /// The inputs, and default values of the parameters; NaN for a measured one, which every query must name.
    contents: PayloadContents,
    inputs: Inputs,
    measured: MeasuredInputs,
    outputs: Vec<LoadedOutput>,
}

impl Answerer {
    /// Loads what the answers of one actuator need.
    ///
    /// # Errors
    /// All problems of the model.
    pub fn load(spec: &ActuatorSpec, model_path: &Path) -> Result<Self, Vec<String>> {
        // A question may be about any gap, whatever the scene's sensors can show.
        let mut wanted = ActuatorSpec { gap_mm: Gap::default(), ..spec.clone() };
        wanted.state.coefficients = true; // answers carry all of them
        if spec.queries != Queries::Fields {
            wanted.outputs.clear();
        }
        let loaded = load(&wanted, model_path)?;
        let header = header(model_path)?;
        Ok(Self::new(spec, loaded, &header))
    }

    fn new(spec: &ActuatorSpec, loaded: LoadedActuator, header: &ModelHeader) -> Self {
        let [pressure_mpa, gap_mm] = ranges(header);
        let (min_mm, max_mm) = spec.gap_mm.range_mm();
        let fixed_mm = (min_mm == max_mm).then_some(min_mm);
        let specs = loaded.session.evaluator().inputs();
        let used = specs.iter().enumerate().filter_map(|(index, spec)| Some((index, spec.value?)));
        let inputs = used.fold(Inputs::new(f64::NAN, f64::NAN), |inputs, (at, value)| inputs.with(at, value));
        let measured = MeasuredInputs::new(spec, specs);
        let inputs = measured.positions().fold(inputs, |inputs, at| inputs.with(at, f64::NAN));
        let constant_mm = (gap_mm[0] == gap_mm[1]).then_some(gap_mm[0]);
        Self {
            name: loaded.spec.name,
            model_hash: loaded.model_hash,
            solver: Solver::new(loaded.session.into_evaluator(), pressure_mpa, gap_mm),
            default_gap_mm: fixed_mm.or(constant_mm),
            default_pressure_mpa: (!loaded.contents.needs.pressure).then_some(0.0),
            contents: loaded.contents,
            inputs,
            measured,
            outputs: loaded.outputs,
        }
    }

    /// The solver, for answers that are not questions of the wire.
    pub fn solver(&mut self) -> &mut Solver {
        &mut self.solver
    }

    /// The state that a twin would publish at this pressure and gap.
    pub fn state(&mut self, pressure_mpa: f64, gap_mm: f64) -> State {
        let mut state = self.contents.state();
        let evaluation = self.solver.evaluate(pressure_mpa, gap_mm);
        publish::fill_state(&mut state, evaluation, &self.contents, StateSpec::default());
        state
    }

    pub fn into_solver(self) -> Solver {
        self.solver
    }

    pub fn default_gap_mm(&self) -> Option<f64> {
        self.default_gap_mm
    }

    /// Values of the field that a question asks for; 0: none, or there is none of that name.
    pub fn entries(&self, query: &Query) -> usize {
        self.output(query).map_or(0, |output| output.reconstructor.entries())
    }

    /// Answers; `values` has room for [`Self::entries`] values.
    pub fn answer(&mut self, query: &Query, values: &mut [f32]) -> Answer {
        let begin = Instant::now();
        let mut answer = Answer { kind: query.kind, actuator: pack_name(&self.name), ..Answer::default() };
        answer.model_hash = self.model_hash;
        (answer.input_count, answer.input_names) = (self.contents.count, self.contents.names);
        match self.take_parameters(query).and_then(|()| self.find(query)) {
            Ok((pressure_mpa, gap_mm, solution)) => {
                if let Some(Solution { uncertainty, low, high, .. }) = solution {
                    (answer.uncertainty, answer.low, answer.high) = (uncertainty, low, high);
                }
                self.solver.evaluate(pressure_mpa, gap_mm);
                self.write(&mut answer);
                self.reconstruct(query, &mut answer, values);
            }
            Err(NoSolution { status, limit }) => (answer.status, answer.limit) = (status.code(), limit),
        }
        answer.compute_ns = begin.elapsed().as_nanos() as u64;
        answer
    }

    /// Works with the question's parameters from now on, and with the scene's where it names none.
    fn take_parameters(&mut self, query: &Query) -> Result<(), NoSolution> {
        let refuse = |status| NoSolution { status, limit: f64::NAN };
        let mut inputs = self.inputs;
        for (name, value) in query.parameters() {
            let position = self.contents.position(name).filter(|position| *position >= PARAMETERS);
            inputs = inputs.with(position.ok_or_else(|| refuse(QueryStatus::UnknownInput))?, value);
            if !value.is_finite() {
                return Err(refuse(QueryStatus::NotFinite));
            }
        }
        if self.measured.positions().any(|at| inputs.values().get(at).is_some_and(|value| value.is_nan())) {
            return Err(refuse(QueryStatus::NotFinite));
        }
        self.solver.set_parameters(&inputs).map_err(|_| refuse(QueryStatus::Model))
    }

    /// Pressure and gap that the question means or asks for.
    fn find(&mut self, query: &Query) -> Result<(f64, f64, Option<Solution>), NoSolution> {
        let refuse = |status| Err(NoSolution { status, limit: f64::NAN });
        let Needs { pressure, gap } = self.contents.needs;
        let is_search = query.kind != query_kind::WHATIF;
        let asks_for_absent = (is_search && !self.solver.has_forces())
            || (!pressure && (query.pressure_mpa.is_finite() || query.kind == query_kind::PRESSURE))
            || (!gap && (query.gap_mm.is_finite() || query.kind == query_kind::GAP));
        if asks_for_absent {
            return refuse(QueryStatus::UnknownInput);
        }
        let gap_mm = if query.gap_mm.is_nan() { self.default_gap_mm } else { Some(query.gap_mm) };
        // No obstacle is an infinite gap.
        let gap_mm = gap_mm.or((query.kind == query_kind::WHATIF).then_some(f64::INFINITY));
        let (asked_mpa, force_n) = (query.pressure_mpa, query.force_n);
        let pressure_mpa =
            if asked_mpa.is_nan() { self.default_pressure_mpa.unwrap_or(f64::NAN) } else { asked_mpa };
        match (query.kind, gap_mm) {
            (query_kind::WHATIF, Some(gap_mm)) if pressure_mpa.is_finite() => {
                Ok((pressure_mpa, gap_mm, None))
            }
            (query_kind::PRESSURE, Some(gap_mm)) if force_n.is_finite() && gap_mm.is_finite() => {
                let found = self.solver.pressure_for_force(gap_mm, force_n)?;
                Ok((found.value, gap_mm, Some(found)))
            }
            (query_kind::GAP, _) if pressure_mpa.is_finite() && force_n.is_finite() => {
                let bar_n =
                    if query.force_halfwidth_n.is_finite() { query.force_halfwidth_n.abs() } else { 0.0 };
                let found = self.solver.gap_for_force(pressure_mpa, force_n, bar_n)?;
                Ok((pressure_mpa, found.value, Some(found)))
            }
            (query_kind::WHATIF | query_kind::PRESSURE | query_kind::GAP, _) => {
                refuse(QueryStatus::NotFinite)
            }
            _ => refuse(QueryStatus::UnknownKind),
        }
    }

    /// Writes the evaluation into the answer, or why there is none.
    fn write(&self, answer: &mut Answer) {
        if !self.solver.is_known() {
            answer.status = QueryStatus::OutsideDomain.code();
            answer.limit = self.solver.gap_mm[1];
            return;
        }
        let evaluation = self.solver.evaluation();
        if evaluation.domain_distance > TrainingRange::ASKED {
            answer.status = QueryStatus::TooFar.code();
            answer.limit = evaluation.domain_distance;
            answer.outside_by = self.contents.of_inputs(&evaluation.outside_by);
        } else if publish::is_answer(evaluation) {
            publish::fill_answer(answer, evaluation, &self.contents);
        } else {
            answer.status = QueryStatus::Model.code();
        }
    }

    fn reconstruct(&self, query: &Query, answer: &mut Answer, values: &mut [f32]) {
        if query.want_field == 0 || answer.status != QueryStatus::Answered.code() {
            return;
        }
        let Some(output) = self.output(query) else {
            answer.status = QueryStatus::NoSuchField.code();
            return;
        };
        match output.reconstructor.reconstruct_into(self.solver.evaluation(), values) {
            Ok(peaks) => publish::fill_answer_field(answer, output, &peaks),
            Err(_) => answer.status = QueryStatus::Model.code(),
        }
    }

    fn output(&self, query: &Query) -> Option<&LoadedOutput> {
        if query.want_field == 0 {
            return None;
        }
        let name = unpack_name(&query.node_set);
        let wanted = if name.is_empty() { "all" } else { &name };
        self.outputs.iter().find(|output| output.spec.topic_name().unwrap_or("all") == wanted)
    }
}

fn header(path: &Path) -> Result<ModelHeader, Vec<String>> {
    let reader = ModelReader::open_file(path);
    let reader = reader.map_err(|error| vec![format!("model: {error} ({})", path.display())])?;
    Ok(reader.header().clone())
}

/// Sampled pressures and gaps of the states in contact (of all states where there is no such regime).
fn ranges(header: &ModelHeader) -> [[f64; 2]; 2] {
    let contact = header.regimes.iter().find(|regime| regime.kind == RegimeKind::Contact);
    let Some(regime) = contact.or(header.regimes.first()) else { return [[0.0; 2]; 2] };
    let range = |input, absent| regime.inputs.range(input).unwrap_or([absent; 2]);
    [range(PRESSURE, 0.0), range(GAP, f64::INFINITY)]
}

/// The answers of a whole scene.
#[derive(Debug)]
pub struct QueryService {
    served: Vec<(QueryServer, Answerer)>,
    wake: WakeSet,
    /// True if queries may wait without a pending event.
    has_more: bool,
}

/// Loads the answerers of a scene; actuators with `queries = "off"` have none.
///
/// # Errors
/// The problems of all actuators at once.
pub fn load_answerers(scene: &Scene, path: &Path) -> Result<Vec<Answerer>, ConfigError> {
    let asked = scene.actuators.iter().filter(|spec| spec.queries != Queries::Off);
    let load = |spec: &ActuatorSpec| Answerer::load(spec, &spec.model);
    config::collect(path, asked.map(|spec| (spec.name.as_str(), load(spec))))
}

impl SideService for QueryService {
    type Model = Vec<Answerer>;

    const NAME: &'static str = "queries";

    fn start(bus: &Bus, answerers: Vec<Answerer>) -> Result<Self, WireError> {
        let served = answerers
            .into_iter()
            .map(|answerer| Ok((QueryServer::create(bus, &answerer.name)?, answerer)))
            .collect::<Result<Vec<_>, WireError>>()?;
        let wake = WakeSet::new(served.iter().map(|(server, _)| server as &dyn Wakeable));
        Ok(Self { served, wake, has_more: false })
    }

    fn replace(&mut self, answerers: Vec<Answerer>) -> bool {
        let same = self.served.iter().map(|(_, old)| &old.name).eq(answerers.iter().map(|new| &new.name));
        if same {
            for ((_, old), new) in self.served.iter_mut().zip(answerers) {
                *old = new;
            }
        }
        same
    }

    /// Waits for questions and answers them. What cannot be sent is logged; its client runs into the time-out.
    fn turn(&mut self, max_wait: Duration) -> Result<(), WireError> {
        // Queries beyond the last batch cause no further event.
        let max_wait = if std::mem::take(&mut self.has_more) { Duration::ZERO } else { max_wait };
        self.wake.wait(max_wait)?;
        for (server, answerer) in &mut self.served {
            match answer_batch(server, answerer) {
                Ok(has_more) => self.has_more |= has_more,
                Err(error) => tracing::warn!("{}: {error}", Self::NAME),
            }
        }
        Ok(())
    }
}

/// Answers what waits, at most [`MAX_BATCH`] questions; true when more may wait.
fn answer_batch(server: &QueryServer, answerer: &mut Answerer) -> Result<bool, WireError> {
    for _ in 0..MAX_BATCH {
        let Some(question) = server.next()? else { return Ok(false) };
        let query = *question.query();
        let entries = answerer.entries(&query);
        let sent = question.answer(entries, |values, answer| *answer = answerer.answer(&query, values));
        if let Err(WireError::NoMemory { needed_bytes, .. }) = sent {
            let plain = Query { want_field: 0, ..query };
            question.answer(0, |values, answer| {
                *answer = answerer.answer(&plain, values);
                (answer.status, answer.limit) = (QueryStatus::NoMemory.code(), needed_bytes as f64);
            })?;
        } else {
            sent?;
        }
    }
    Ok(true)
}
