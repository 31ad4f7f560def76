//! The steps of one actuator's readings, in their order: poll, ingest, evaluate, reconstruct into the loan, publish, record
//! the outcome.

use super::events::{EventKind, EventSender};
use super::force_watch::ForceWatch;
use super::ingest::{Needed, Validator};
use super::reconstruct::{FieldError, FieldOutput};
use super::record::Record;
use super::swap::{Retired, Running};
use crate::config::{Limits, OutsideDomain, StateSpec, ms_to_ns};
use crate::estimation::{Estimator, HALFWIDTH_SIGMAS};
use crate::load::{GroupSizes, Loaded};
use crate::payload;
use crate::source::FORCE;
use rom::evaluation::Evaluation;
use rom::hull::DomainStatus;
use rom::hysteresis::{HysteresisEvaluator, RegimeLabel};
use rom::inputs::{GAP, Inputs, PRESSURE};
use rom::snapshots::RegimeKind;
use std::collections::VecDeque;
use wire::layout::{INPUTS_MAX, VERSION, flags, input_source, pack_name};
use wire::{
    Bus, Estimate, EstimateWriter, Health, HealthWriter, Outcome, SensorReader, SensorSample, State,
    StateWriter, Topic, WireError, now_ns,
};

/// Readings taken in one turn: a publisher that is faster than the loop must not keep it from its stop flag.
const MAX_BATCH: usize = 1024;

/// A load cell is within so many standard deviations of the force.
const WATCH_SIGMAS: f64 = 2.0;

/// One actuator of a running twin.
#[derive(Debug)]
pub(super) struct ActuatorTwin {
    pub(super) reader: SensorReader,
    state_writer: StateWriter,
    pub(super) outputs: Vec<FieldOutput>,
    evaluator: HysteresisEvaluator,
    evaluation: Evaluation,
    label: RegimeLabel,
    validator: Validator,
    /// Good readings that are not answered yet, with the time of taking; never more than `backlog`.
    waiting: VecDeque<(SensorSample, u64)>,
    backlog: usize,
    force_watch: ForceWatch,
    /// Standard deviation of the load cell, N.
    force_sigma_n: f64,
    group_sizes: GroupSizes,
    wanted: StateSpec,
    limits: Limits,
    /// What the scene has estimated: the filter, its topic, the last estimate.
    estimation: Option<(Estimator, EstimateWriter, Estimate)>,
    /// Where the value of each input comes from, where the readings have all that they may have.
    input_sources: [u8; INPUTS_MAX],
    /// The last state, sent again with flags when readings are held or stay away.
    state: State,
    record: Record,
    /// When the last good reading was taken; the start before there was one.
    last_good_ns: u64,
    next_deadline_ns: u64,
}

impl ActuatorTwin {
    /// Becomes the twin of the actuator: opens its topics, reserves their memory.
    pub(super) fn start(
        bus: &Bus,
        number: u32,
        loaded: Loaded,
        limits: Limits,
        boot_id: u64,
        events: EventSender,
    ) -> Result<Self, WireError> {
        let name = loaded.spec.name.clone();
        let validator = Validator::new(limits, Needed::of(&loaded));
        // The state topic comes first: it is the one that a second twin is refused at.
        let state_writer = StateWriter::create(bus, &Topic::state(&name)?)?;
        let health_writer = HealthWriter::create(bus, &Topic::health(&name)?)?;
        let outputs = loaded
            .outputs
            .into_iter()
            .map(|output| FieldOutput::start(bus, &name, loaded.model_hash, boot_id, output))
            .collect::<Result<_, WireError>>()?;
        let estimation = loaded
            .estimator
            .map(|estimator| {
                let writer = EstimateWriter::create(bus, &Topic::estimate(&name)?)?;
                let (model_hash, actuator) = (loaded.model_hash, pack_name(&name));
                let estimate = Estimate { model_hash, boot_id, actuator, ..estimator.payload() };
                Ok::<_, WireError>((estimator, writer, estimate))
            })
            .transpose()?;
        let reader = SensorReader::attach(bus, &Topic::sensor(loaded.spec.sensor())?)?;
        let (model_hash, actuator) = (loaded.model_hash, pack_name(&name));
        let inputs = loaded.evaluator.inputs();
        let (input_count, input_names) = payload::input_names(inputs);
        let input_sources = payload::input_sources(&loaded.spec, inputs);
        let health = Health { model_hash, boot_id, actuator, ..Health::default() };
        let record = Record::new(number, health_writer, health, events);
        let last_good_ns = record.start_ns();
        Ok(Self {
            reader,
            state_writer,
            outputs,
            evaluation: loaded.evaluator.evaluation(),
            evaluator: HysteresisEvaluator::new(loaded.evaluator),
            estimation,
            label: RegimeLabel { regime: RegimeKind::Free, held: false },
            validator,
            input_sources,
            waiting: VecDeque::with_capacity(loaded.spec.backlog),
            backlog: loaded.spec.backlog,
            force_watch: ForceWatch::default(),
            force_sigma_n: loaded.spec.sigmas().get(FORCE).copied().unwrap_or(f64::NAN),
            group_sizes: loaded.group_sizes,
            wanted: loaded.spec.state,
            limits,
            state: State {
                model_hash,
                boot_id,
                actuator,
                input_count,
                input_names,
                input_sources,
                ..State::default()
            },
            record,
            last_good_ns,
            next_deadline_ns: last_good_ns + ms_to_ns(limits.deadline_ms),
        })
    }

    /// What its readers hold on to.
    pub(super) fn running(&self) -> Running<'_> {
        Running {
            name: self.state_writer.topic().actuator(),
            sensor: self.reader.topic().actuator(),
            outputs: self.outputs.iter().map(FieldOutput::shape).collect(),
            estimates: self.estimation.is_some(),
        }
    }

    /// Continues with another model; the caller has checked that names and shapes are the same.
    pub(super) fn swap(&mut self, loaded: Loaded, retired: &mut Retired) {
        self.validator.set_needed(Needed::of(&loaded));
        self.evaluation = loaded.evaluator.evaluation();
        let inputs = loaded.evaluator.inputs();
        (self.state.input_count, self.state.input_names) = payload::input_names(inputs);
        self.input_sources = payload::input_sources(&loaded.spec, inputs);
        self.state.input_sources = self.input_sources;
        let new = HysteresisEvaluator::new(loaded.evaluator);
        retired.evaluators.push(std::mem::replace(&mut self.evaluator, new));
        for (output, new) in self.outputs.iter_mut().zip(loaded.outputs) {
            retired.reconstructors.push(output.swap(loaded.model_hash, new));
        }
        if let (Some((estimator, _, estimate)), Some(new)) = (&mut self.estimation, loaded.estimator) {
            // Another model, or other priors: what was found with the old one does not hold.
            let Estimate { boot_id, actuator, seq, .. } = *estimate;
            *estimate = Estimate { model_hash: loaded.model_hash, boot_id, actuator, seq, ..new.payload() };
            retired.estimators.push(std::mem::replace(estimator, new));
        }
        self.backlog = loaded.spec.backlog;
        self.waiting.reserve(self.backlog.saturating_sub(self.waiting.len()));
        self.group_sizes = loaded.group_sizes;
        self.wanted = loaded.spec.state;
        self.state.model_hash = loaded.model_hash;
        self.record.health.model_hash = loaded.model_hash;
    }

    /// When this actuator must be served again at the latest.
    pub(super) fn next_due_ns(&self) -> u64 {
        self.next_deadline_ns.min(self.record.next_health_ns())
    }

    /// Takes the waiting readings, answers the newest good ones (one unless the scene says more), then does what is due by
    /// the clock.
    pub(super) fn serve(&mut self) {
        for _ in 0..MAX_BATCH {
            let Some(sample) = self.poll() else { break };
            self.ingest(sample);
        }
        self.answer_waiting();
        let now = now_ns();
        if now >= self.next_deadline_ns {
            self.miss_deadline(now);
        }
        self.record.send_health(now, self.last_good_ns);
    }

    /// Step 1: the oldest reading that waits on the sensor topic.
    fn poll(&mut self) -> Option<SensorSample> {
        let received = self.reader.next();
        received.unwrap_or_else(|_| {
            self.record.failed(EventKind::ReceiveFailed);
            None
        })
    }

    /// Step 2: validates. A good reading waits for its answer; any other ends here.
    fn ingest(&mut self, sample: SensorSample) {
        let now = now_ns();
        let check = self.validator.validate(&sample, now);
        self.record.ingested(&sample, &check);
        match check.rejection {
            None => {
                if self.waiting.len() == self.backlog {
                    self.waiting.pop_front();
                    self.record.record_outcome(Outcome::DroppedSuperseded);
                }
                self.waiting.push_back((sample, now));
            }
            Some(outcome) => {
                if outcome.is_held() {
                    // The good readings before it come first: their states must not be sent after the held one.
                    self.answer_waiting();
                    self.hold(outcome, now);
                }
                self.record.record_outcome(outcome);
            }
        }
    }

    /// Steps 3 to 6 for every good reading that waits.
    fn answer_waiting(&mut self) {
        while let Some((sample, taken_ns)) = self.waiting.pop_front() {
            let outcome = match self.evaluate(&sample) {
                Ok(()) => self.publish(&sample, taken_ns),
                Err(outcome) => {
                    if outcome.is_held() {
                        self.hold(outcome, taken_ns);
                    }
                    outcome
                }
            };
            self.record.record_outcome(outcome);
            // Not while a reading waits for its answer: the next samples are on loan before the next reading comes.
            self.outputs.iter_mut().for_each(FieldOutput::loan_ahead);
        }
    }

    /// Step 3: force, gradients and half-widths of the reading. The coefficients wait for the fields unless states carry them.
    fn evaluate(&mut self, sample: &SensorSample) -> Result<(), Outcome> {
        let mut inputs = self.validator.inputs(sample);
        if let Some((estimator, _, estimate)) = &mut self.estimation {
            let update = estimator.update(sample, &inputs);
            estimator.fill(&update, estimate);
            inputs = self.validator.with_idle(Inputs::from(update.inputs), &inputs);
        }
        self.label = self.evaluator.state(inputs, &mut self.evaluation);
        if self.wanted.coefficients {
            self.evaluator.complete(&mut self.evaluation);
        }
        if !payload::is_finite(&self.evaluation) {
            return Err(Outcome::DroppedModel);
        }
        match (self.evaluation.domain, self.limits.outside_domain) {
            (DomainStatus::Outside, OutsideDomain::Hold) => Err(Outcome::HeldOutsideDomain),
            (DomainStatus::Outside, OutsideDomain::Refuse) => Err(Outcome::DroppedOutsideDomain),
            _ => Ok(()),
        }
    }

    /// Steps 4 and 5: sends the state, which waits for no field, then reconstructs each field into its loan and sends it.
    /// Returns what became of the reading.
    fn publish(&mut self, sample: &SensorSample, taken_ns: u64) -> Outcome {
        self.describe(sample, taken_ns);
        let mut outcome = if self.send_state() { Outcome::Published } else { Outcome::DroppedNotSent };
        self.send_estimate(sample);
        for output in self.outputs.iter_mut().filter(|output| output.is_due(sample.t_sensor_ns)) {
            self.evaluator.complete(&mut self.evaluation);
            let field = output.reconstruct(&self.evaluation);
            match field.and_then(|field| output.publish(field, &self.state)) {
                Ok(()) => self.record.health.fields_sent += 1,
                Err(FieldError::Reconstruction) => {
                    self.record.failed(EventKind::ReconstructionFailed);
                    outcome = Outcome::DroppedReconstruction;
                }
                Err(FieldError::Transport) => {
                    self.record.failed(EventKind::SendFailed);
                    if outcome == Outcome::Published {
                        outcome = Outcome::DroppedNotSent;
                    }
                }
            }
        }
        self.record.answered(sample, taken_ns);
        // A good reading came: the deadline begins anew.
        self.record.good(self.state.flags, taken_ns.saturating_sub(self.last_good_ns));
        self.last_good_ns = taken_ns;
        self.next_deadline_ns = taken_ns + ms_to_ns(self.limits.deadline_ms);
        outcome
    }

    /// Fills the state from the evaluation and the reading.
    fn describe(&mut self, sample: &SensorSample, taken_ns: u64) {
        let (evaluation, state) = (&mut self.evaluation, &mut self.state);
        if let Some((estimator, _, estimate)) = &mut self.estimation {
            estimate.force_sigma_n = estimator.force_sigma_n(evaluation);
            let of_estimate_n = HALFWIDTH_SIGMAS * estimate.force_sigma_n;
            evaluation.halfwidths.force_n = evaluation.halfwidths.force_n.hypot(of_estimate_n);
        }
        let (regime_before, flags_before) = (state.regime, self.record.health.flags);
        payload::fill_state(state, evaluation, &self.group_sizes, self.wanted);
        payload::fill_label(state, self.label);
        state.outcome = Outcome::Published.code();
        state.sensor_boot_id = sample.boot_id;
        state.sensor_seq = sample.seq;
        state.t_sensor_ns = sample.t_sensor_ns;
        state.measured_force_n = sample.measured_force_n;
        state.input_sources = self.input_sources;
        // A pressure or a gap that no answer depends on may be absent.
        for (at, value) in [(PRESSURE, sample.pressure_mpa), (GAP, sample.gap_mm)] {
            let source = state.input_sources.get_mut(at);
            if let Some(source) = source.filter(|source| value.is_nan() && **source == input_source::MEASURED)
            {
                *source = input_source::NOMINAL;
            }
        }
        let residual_n = sample.measured_force_n - evaluation.contact_force_n;
        let after_ns = ms_to_ns(self.limits.force_mismatch_ms);
        let allowed_n = evaluation.halfwidths.force_n.hypot(WATCH_SIGMAS * self.force_sigma_n);
        let mismatch = self.force_watch.update(sample.t_sensor_ns, residual_n, allowed_n, after_ns);
        let late = taken_ns.saturating_sub(sample.t_sensor_ns) > ms_to_ns(self.limits.late_ms);
        for (bit, set) in [
            (flags::FORCE_MEASURED, sample.measured_force_n.is_finite()),
            (flags::FORCE_MISMATCH, mismatch),
            (flags::LATE, late),
        ] {
            state.flags |= if set { bit } else { 0 };
        }
        self.record.health.late += u64::from(late);
        if (state.flags ^ flags_before) & flags::FORCE_MISMATCH != 0 {
            self.record.event(EventKind::ForceMismatch, u64::from(mismatch));
        }
        if regime_before != state.regime {
            self.record.event(EventKind::Regime, state.regime.into());
        }
    }

    /// Sends the state as it is, with its age; a failure is counted.
    fn send_state(&mut self) -> bool {
        let now = now_ns();
        self.state.layout_version = VERSION;
        self.state.seq += 1;
        self.state.t_publish_ns = now;
        self.state.age_ns = match self.state.t_sensor_ns {
            0 => now.saturating_sub(self.record.start_ns()),
            t_sensor_ns => now.saturating_sub(t_sensor_ns),
        };
        let sent = self.state_writer.publish(self.state).is_ok();
        self.record.health.states_sent += u64::from(sent);
        if !sent {
            self.record.failed(EventKind::SendFailed);
        }
        sent
    }

    /// Sends the estimate that belongs to the state.
    fn send_estimate(&mut self, sample: &SensorSample) {
        let Some((_, writer, estimate)) = &mut self.estimation else { return };
        estimate.seq += 1;
        estimate.sensor_boot_id = sample.boot_id;
        estimate.sensor_seq = sample.seq;
        estimate.t_sensor_ns = sample.t_sensor_ns;
        estimate.t_publish_ns = now_ns();
        if writer.publish(*estimate).is_err() {
            self.record.failed(EventKind::SendFailed);
        }
    }

    /// Sends the last good values again, marked as held, with the reason.
    fn hold(&mut self, outcome: Outcome, now: u64) {
        self.state.flags |= flags::HELD;
        self.state.outcome = outcome.code();
        // Past the deadline, the stale state that is about to be sent carries both flags.
        if now < self.next_deadline_ns {
            self.send_state();
        }
    }

    /// No good reading within the deadline: sends a stale state, once every deadline, with the growing age.
    fn miss_deadline(&mut self, now: u64) {
        if self.state.flags & flags::STALE == 0 {
            self.record.health.deadline_misses += 1;
            self.record.event(EventKind::Stale, now.saturating_sub(self.last_good_ns));
        }
        self.state.flags |= flags::STALE;
        self.record.health.flags = self.state.flags;
        self.send_state();
        // Estimates come with readings only; whoever begins to read in between gets the last one.
        if let Some((_, writer, _)) = &self.estimation
            && writer.serve_late_readers().is_err()
        {
            self.record.failed(EventKind::SendFailed);
        }
        self.next_deadline_ns = now + ms_to_ns(self.limits.deadline_ms);
    }

    /// The wait for readings failed.
    pub(super) fn wait_failed(&mut self) {
        self.record.failed(EventKind::WaitFailed);
    }

    /// The counters so far.
    pub(super) fn health(&self) -> &Health {
        &self.record.health
    }
}
