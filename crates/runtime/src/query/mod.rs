//! Answers to questions about a scene's actuators, in a thread of their own: the twin's loop knows nothing of them.
//!
//! Every actuator gets a second model in memory: the small part always, the basis only where the scene says
//! `queries = "fields"`.

mod solve;

pub use solve::{NoSolution, Solution, Solver};

use crate::config::{ActuatorSpec, ConfigError, Gap, Queries, Scene};
use crate::twin::{Loaded, LoadedOutput, load, regime_number};
use rom::evaluation::Evaluation;
use rom::hull::DomainStatus;
use rom::interpolant::Quantity;
use rom::model::{ModelHeader, ModelReader};
use rom::snapshots::RegimeKind;
use std::fs::File;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use wire::layout::{COEFFICIENTS_MAX, FIELD_SLOTS, GROUPS_MAX, flags, pack_name, query_kind, unpack_name};
use wire::{Answer, Bus, Query, QueryServer, QueryStatus, WakeSet, Wakeable, WireError};

/// Longest sleep: the shutdown flag is looked at that often.
const MAX_WAIT: Duration = Duration::from_millis(100);

/// One actuator's model, ready to answer.
#[derive(Debug)]
pub struct Answerer {
    name: String,
    model_hash: [u8; 16],
    solver: Solver,
    /// The gap that stands in when a question names none; none: it must.
    default_gap_mm: Option<f64>,
    group_sizes: Vec<(RegimeKind, Vec<u8>)>,
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
        if spec.queries != Queries::Fields {
            wanted.outputs.clear();
        }
        let loaded = load(&wanted, model_path)?;
        let header = header(model_path)?;
        Ok(Self::new(spec, loaded, &header))
    }

    fn new(spec: &ActuatorSpec, loaded: Loaded, header: &ModelHeader) -> Self {
        let [pressure_mpa, gap_mm] = ranges(header);
        let (min_mm, max_mm) = spec.gap_mm.range_mm();
        let fixed_mm = (min_mm == max_mm).then_some(min_mm);
        let constant_mm = (gap_mm[0] == gap_mm[1]).then_some(gap_mm[0]);
        Self {
            name: loaded.spec.name,
            model_hash: loaded.model_hash,
            solver: Solver::new(loaded.evaluator, loaded.regimes, pressure_mpa, gap_mm),
            default_gap_mm: fixed_mm.or(constant_mm),
            group_sizes: loaded.group_sizes,
            outputs: loaded.outputs,
        }
    }

    /// The solver, for answers that are not questions of the wire.
    pub fn solver(&mut self) -> &mut Solver {
        &mut self.solver
    }

    /// The solver alone.
    pub fn into_solver(self) -> Solver {
        self.solver
    }

    /// The gap that stands in when none is given, mm.
    pub fn default_gap_mm(&self) -> Option<f64> {
        self.default_gap_mm
    }

    /// Values of the field that a question asks for; 0: none, or there is none of that name.
    pub fn entries(&self, query: &Query) -> usize {
        self.output(query).map_or(0, |output| output.predictor.entries())
    }

    /// Answers; `values` has room for [`Self::entries`] values.
    pub fn answer(&mut self, query: &Query, values: &mut [f32]) -> Answer {
        let begin = Instant::now();
        let mut answer = Answer { kind: query.kind, actuator: pack_name(&self.name), ..Answer::default() };
        answer.model_hash = self.model_hash;
        match self.find(query) {
            Ok((pressure_mpa, gap_mm, solution)) => {
                if let Some(Solution { uncertainty, low, high, .. }) = solution {
                    (answer.uncertainty, answer.low, answer.high) = (uncertainty, low, high);
                }
                self.solver.evaluate(pressure_mpa, gap_mm);
                self.describe(&mut answer);
                self.reconstruct(query, &mut answer, values);
            }
            Err(NoSolution { verdict, limit }) => (answer.verdict, answer.limit) = (verdict.code(), limit),
        }
        answer.compute_ns = begin.elapsed().as_nanos() as u64;
        answer
    }

    /// Pressure and gap that the question means or asks for.
    fn find(&mut self, query: &Query) -> Result<(f64, f64, Option<Solution>), NoSolution> {
        let refuse = |verdict| Err(NoSolution { verdict, limit: f64::NAN });
        let gap_mm = if query.gap_mm.is_nan() { self.default_gap_mm } else { Some(query.gap_mm) };
        // No obstacle is a gap without end.
        let gap_mm = gap_mm.or((query.kind == query_kind::WHATIF).then_some(f64::INFINITY));
        let (pressure_mpa, force_n) = (query.pressure_mpa, query.force_n);
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

    fn describe(&self, answer: &mut Answer) {
        if !self.solver.is_known() {
            answer.verdict = QueryStatus::OutsideDomain.code();
            answer.limit = self.solver.gap_mm[1];
            return;
        }
        let e: &Evaluation = self.solver.evaluation();
        if !e.contact_force_n.is_finite() || e.coefficients.iter().any(|a| !a.is_finite()) {
            answer.verdict = QueryStatus::Model.code();
            return;
        }
        answer.pressure_mpa = e.input.pressure_mpa;
        answer.gap_mm = e.input.gap_mm;
        answer.regime = regime_number(e.regime);
        answer.contact_force_n = e.contact_force_n;
        answer.force_by_pressure_n_per_mpa = e.dforce_dpressure;
        answer.force_by_gap_n_per_mm = e.dforce_dgap;
        answer.onset_pressure_mpa = e.onset_pressure_mpa.unwrap_or(f64::INFINITY);
        answer.force_halfwidth_n = e.bars.force_n as f32;
        answer.displacement_halfwidth_mm = e.bars.displacement_mm as f32;
        answer.von_mises_halfwidth_mpa = e.bars.stress_mpa as f32;
        answer.domain_distance = e.domain_distance as f32;
        let (verdict, domain_flags) = match e.domain {
            DomainStatus::Inside => (0, 0),
            DomainStatus::Near => (1, flags::NEAR_EDGE),
            DomainStatus::Outside => (2, flags::OUTSIDE_DOMAIN),
        };
        answer.domain_status = verdict;
        let clamped = if e.flags.force_clamped { flags::FORCE_CLAMPED } else { 0 };
        let cut = if e.coefficients.len() > COEFFICIENTS_MAX { flags::COEFFICIENTS_CUT } else { 0 };
        answer.flags = domain_flags | clamped | cut;
        answer.coefficient_count = e.coefficients.len().min(COEFFICIENTS_MAX) as u32;
        for (to, from) in answer.coefficients.iter_mut().zip(&e.coefficients) {
            *to = *from as f32;
        }
        let sizes = self.group_sizes.iter().find(|(kind, _)| *kind == e.basis);
        answer.group_sizes = sizes.map_or([0; GROUPS_MAX], |(_, sizes)| head(sizes));
    }

    fn reconstruct(&self, query: &Query, answer: &mut Answer, values: &mut [f32]) {
        if query.want_field == 0 || answer.verdict != QueryStatus::Answered.code() {
            return;
        }
        let Some(output) = self.output(query) else {
            answer.verdict = QueryStatus::NoSuchField.code();
            return;
        };
        let Ok(peaks) = output.predictor.reconstruct_into(self.solver.evaluation(), values) else {
            answer.verdict = QueryStatus::Model.code();
            return;
        };
        answer.node_count = output.predictor.rows() as u32;
        answer.field_count = output.predictor.field_count() as u32;
        answer.field_ids = head::<FIELD_SLOTS>(&output.field_ids);
        answer.node_set = pack_name(output.spec.topic_name().unwrap_or("all"));
        if let Some(peak) = peaks.stress_mpa {
            (answer.max_von_mises_mpa, answer.max_von_mises_node) = (peak.value.into(), peak.node);
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

/// The first entries of a list in an array of fixed size.
fn head<const N: usize>(from: &[u8]) -> [u8; N] {
    let mut out = [0; N];
    for (to, from) in out.iter_mut().zip(from) {
        *to = *from;
    }
    out
}

fn header(path: &Path) -> Result<ModelHeader, Vec<String>> {
    let at = |text: String| vec![format!("model: {text} ({})", path.display())];
    let file = File::open(path).map_err(|error| at(format!("cannot open: {error}")))?;
    let reader = ModelReader::open(file).map_err(|error| at(error.to_string()))?;
    Ok(reader.header().clone())
}

/// Sampled pressures and gaps of the states in contact (of all states where there is no such regime).
fn ranges(header: &ModelHeader) -> [[f64; 2]; 2] {
    let contact = header.regimes.iter().find(|regime| regime.kind == RegimeKind::Contact);
    let Some(regime) = contact.or(header.regimes.first()) else { return [[0.0; 2]; 2] };
    let range = |quantity: Quantity| {
        let axis = regime.inputs.axes.iter().find(|axis| axis.quantity == quantity);
        axis.map(|axis| [axis.min, axis.max])
    };
    let constant = regime.inputs.constant_gap_mm.unwrap_or(f64::INFINITY);
    [range(Quantity::PressureMpa).unwrap_or([0.0; 2]), range(Quantity::GapMm).unwrap_or([constant; 2])]
}

/// The answers of a whole scene.
#[derive(Debug)]
pub struct QueryService {
    served: Vec<(QueryServer, Answerer)>,
    wake: WakeSet,
}

/// Loads the answerers of a scene; actuators with `queries = "off"` have none.
///
/// # Errors
/// The problems of all actuators at once.
pub fn load_answerers(scene: &Scene, path: &Path) -> Result<Vec<Answerer>, ConfigError> {
    let (mut answerers, mut problems) = (Vec::new(), Vec::new());
    for spec in scene.actuators.iter().filter(|spec| spec.queries != Queries::Off) {
        match Answerer::load(spec, &scene.resolve(&spec.model)) {
            Ok(answerer) => answerers.push(answerer),
            Err(found) => {
                problems.extend(found.into_iter().map(|text| format!("actuator `{}`: {text}", spec.name)))
            }
        }
    }
    if problems.is_empty() { Ok(answerers) } else { Err(ConfigError { path: path.into(), problems }) }
}

impl QueryService {
    /// Becomes the one that answers for all of them.
    ///
    /// # Errors
    /// The refusals of [`QueryServer::create`].
    pub fn start(bus: &Bus, answerers: Vec<Answerer>) -> Result<Self, WireError> {
        let served = answerers
            .into_iter()
            .map(|answerer| Ok((QueryServer::create(bus, &answerer.name)?, answerer)))
            .collect::<Result<Vec<_>, WireError>>()?;
        let wake = WakeSet::new(served.iter().map(|(server, _)| server as &dyn Wakeable));
        Ok(Self { served, wake })
    }

    /// Continues with other models of the same actuators. False, and nothing changed, when they are others.
    pub fn replace(&mut self, answerers: Vec<Answerer>) -> bool {
        let same = self.served.iter().map(|(_, old)| &old.name).eq(answerers.iter().map(|new| &new.name));
        if same {
            for ((_, old), new) in self.served.iter_mut().zip(answerers) {
                *old = new;
            }
        }
        same
    }

    /// Answers until `stop`. What cannot be sent is said in the log; the asker runs into its timeout.
    pub fn run(&mut self, stop: &AtomicBool) {
        self.run_with(stop, |_| ());
    }

    /// The same, with something to do between two turns.
    pub fn run_with(&mut self, stop: &AtomicBool, mut between: impl FnMut(&mut Self)) {
        while !stop.load(Ordering::Relaxed) {
            self.turn(MAX_WAIT);
            between(self);
        }
    }

    /// Waits for questions, at most `max_wait`, and answers all that wait.
    pub fn turn(&mut self, max_wait: Duration) {
        let servers = self.served.iter().map(|(server, _)| server as &dyn Wakeable);
        if let Err(error) = self.wake.wait(servers, max_wait) {
            tracing::warn!("queries: {error}");
            std::thread::sleep(max_wait); // a broken wait must not become a spin
        }
        for (server, answerer) in &mut self.served {
            if let Err(error) = answer_all(server, answerer) {
                tracing::warn!("queries: {error}");
            }
        }
    }
}

fn answer_all(server: &QueryServer, answerer: &mut Answerer) -> Result<(), WireError> {
    while let Some(question) = server.next()? {
        let query = *question.query();
        let entries = answerer.entries(&query);
        let sent =
            server.answer(&question, entries, |values, answer| *answer = answerer.answer(&query, values));
        if let Err(WireError::NoMemory { needed_bytes, .. }) = sent {
            let plain = Query { want_field: 0, ..query };
            server.answer(&question, 0, |values, answer| {
                *answer = answerer.answer(&plain, values);
                (answer.verdict, answer.limit) = (QueryStatus::NoMemory.code(), needed_bytes as f64);
            })?;
        } else {
            sent?;
        }
    }
    Ok(())
}
