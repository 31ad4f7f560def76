//! The twin: waits for readings and answers each with a state and fields. One thread for any number of actuators.
//!
//! Steps of every reading, in this order ([`ActuatorTwin`] calls them):
//!
//! | step | file |
//! | --- | --- |
//! | 1. poll: take it from the sensor topic | `mod.rs` |
//! | 2. ingest: validate it, let the session take it; a good one waits for its answer | `ingest.rs`, `mod.rs` |
//! | 3. evaluate: coefficients, force, gradients, half-widths with the residual's contribution; fill the state | `mod.rs`, `residual.rs`, `markers.rs`, `observed.rs`, `../publish.rs` |
//! | 4. reconstruct: write each field into a sample on loan | `../publish.rs` |
//! | 5. publish: send state and fields | `mod.rs`, `../publish.rs` |
//! | 6. record the outcome: count it once, after its outputs | `record.rs` |
//!
//! After start the loop allocates nothing (except the transport's handle for each loaned sample, which a test counts), takes no
//! lock and writes no log: its events go through a channel. Its only system calls are the wait and the wake-up of readers.

mod deadline;
mod ingest;
mod markers;
mod observed;
mod parts;
mod record;
mod residual;
mod swap;

pub use deadline::Deadline;
pub use record::{Event, EventKind, EventSender, event_channel};
pub use swap::{Retired, SwapError};

use crate::config::{Limits, OutsideDomain, Settings, ms_to_ns};
use crate::estimation::{Estimator, NewValues};
use crate::load::LoadedActuator;
use crate::publish::{self, FieldError, FieldOutput};
use ingest::Validator;
use parts::Parts;
use record::Record;
use residual::{Residual, ResidualWatch};
use rom::evaluation::Evaluation;
use rom::evaluator::RegimeLabel;
use rom::halfwidths::HALFWIDTH_SIGMAS;
use rom::hull::DomainStatus;
use rom::inertia::stepper::ReadingError;
use rom::inputs::Inputs;
use rom::session::FilteredInputs;
use rom::snapshots::RegimeKind;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;
use swap::RunningActuator;
use wire::layout::{LAYOUT_VERSION, estimate_alarm, flags, pack_name};
use wire::{
    Bus, Estimate, EstimateWriter, Health, HealthWriter, Outcome, SensorReader, SensorSample, State,
    StateWriter, Topic, WakeSet, Wakeable, WireError, boot_id, now_ns,
};

/// Longest sleep: the stop flag is checked that often, and the watchdog sees progress.
const MAX_WAIT: Duration = Duration::from_millis(100);

/// Largest number of readings per iteration, so that a fast publisher does not delay the stop flag.
const MAX_BATCH: usize = 1024;

/// A running twin with all its topics open.
#[derive(Debug)]
pub struct Twin {
    actuators: Vec<ActuatorTwin>,
    wait: WakeSet,
    busy_poll: bool,
}

impl Twin {
    /// Becomes the twin of all actuators of a scene.
    ///
    /// # Errors
    /// [`WireError::AlreadyPublished`] when another twin serves one of them, [`WireError::NoMemory`] when /dev/shm is
    /// full, and the other refusals of the ports.
    pub fn start(
        bus: &Bus,
        loaded: Vec<LoadedActuator>,
        settings: &Settings,
        events: &EventSender,
    ) -> Result<Self, WireError> {
        let boot_id = boot_id();
        let actuators: Vec<ActuatorTwin> = (0..)
            .zip(loaded)
            .map(|(number, loaded)| {
                ActuatorTwin::start(bus, number, loaded, settings.limits, boot_id, events.clone())
            })
            .collect::<Result<_, WireError>>()?;
        let wait = WakeSet::new(actuators.iter().map(|actuator| &actuator.reader as &dyn Wakeable));
        Ok(Self { actuators, wait, busy_poll: settings.realtime.busy_poll })
    }

    /// Maps all pages of all samples ahead of use; returns the bytes.
    pub fn prefault(&self) -> std::io::Result<u64> {
        self.actuators.iter().flat_map(|actuator| &actuator.outputs).map(|output| output.prefault()).sum()
    }

    /// Runs until `stop`; calls `between` after each iteration (for a swap). `progress` counts iterations for the watchdog.
    pub fn run(&mut self, stop: &AtomicBool, progress: &AtomicU64, mut between: impl FnMut(&mut Self)) {
        while !stop.load(Ordering::Relaxed) {
            self.turn(MAX_WAIT);
            progress.fetch_add(1, Ordering::Relaxed);
            between(self);
        }
    }

    /// Waits for readings (at most `max_wait`, or until something is due), then serves every actuator once.
    pub fn turn(&mut self, max_wait: Duration) {
        if !self.busy_poll {
            let due_ns = self.actuators.iter().map(ActuatorTwin::next_due_ns).min().unwrap_or(u64::MAX);
            let timeout = Duration::from_nanos(due_ns.saturating_sub(now_ns())).min(max_wait);
            if self.wait.wait(timeout).is_err() {
                self.actuators.iter_mut().for_each(|actuator| actuator.record.failed(EventKind::WaitFailed));
                std::thread::sleep(max_wait); // a failing wait must not become a busy loop
            }
        }
        self.actuators.iter_mut().for_each(ActuatorTwin::serve);
    }

    /// Continues with other models for the same actuators and topics. All or nothing.
    ///
    /// Cost: a few pointers an actuator; nothing is loaded, nothing freed.
    ///
    /// # Errors
    /// [`SwapError`]; the twin is as before.
    pub fn swap(&mut self, loaded: Vec<LoadedActuator>) -> Result<Retired, SwapError> {
        let running: Vec<_> = self.actuators.iter().map(ActuatorTwin::running).collect();
        swap::check(&running, &loaded)?;
        let mut retired = Retired::default();
        for (actuator, loaded) in self.actuators.iter_mut().zip(loaded) {
            actuator.swap(loaded, &mut retired);
        }
        Ok(retired)
    }

    /// Counters of every actuator.
    pub fn health(&self) -> impl Iterator<Item = &Health> {
        self.actuators.iter().map(ActuatorTwin::health)
    }
}

/// Outcome of a reading that the session does not take.
fn refused(error: ReadingError) -> Outcome {
    match error {
        ReadingError::NotLater { .. } => Outcome::DroppedBackInTime,
        ReadingError::NotFinite { .. } => Outcome::DroppedModel,
    }
}

/// One actuator of a running twin.
#[derive(Debug)]
struct ActuatorTwin {
    reader: SensorReader,
    state_writer: StateWriter,
    outputs: Vec<FieldOutput>,
    parts: Parts,
    evaluation: Evaluation,
    label: RegimeLabel,
    validator: Validator,
    /// Good readings that are not answered yet; never more than the backlog.
    waiting: VecDeque<WaitingReading>,
    force_watch: ResidualWatch,
    limits: Limits,
    deadline: Deadline,
    /// `None` if the scene estimates nothing.
    estimation: Option<Estimation>,
    /// The last state, sent again with flags when readings are held or stay away.
    state: State,
    record: Record,
    /// When the last good reading was taken; the start before there was one.
    last_good_ns: u64,
    /// There was a good reading.
    has_answered: bool,
    /// The last reading was outside the training range.
    was_outside: bool,
    next_deadline_ns: u64,
}

/// A good reading with the time of taking it from the topic.
#[derive(Debug, Clone, Copy)]
struct WaitingReading {
    sample: SensorSample,
    taken_ns: u64,
    filtered: FilteredInputs,
}

/// Filter, topic and last estimate of an actuator.
#[derive(Debug)]
struct Estimation {
    estimator: Estimator,
    writer: EstimateWriter,
    estimate: Estimate,
}

/// What the comparison of a reading's measured values with the model's answer came to.
#[derive(Debug, Clone, Copy)]
struct WatchedResiduals {
    has_force_mismatch: bool,
    has_marker_mismatch: bool,
    has_observable_mismatch: bool,
}

impl ActuatorTwin {
    /// Becomes the twin of the actuator: opens its topics, reserves their memory.
    fn start(
        bus: &Bus,
        number: u32,
        mut loaded: LoadedActuator,
        limits: Limits,
        boot_id: u64,
        events: EventSender,
    ) -> Result<Self, WireError> {
        let (name, model_hash) = (loaded.spec.name.clone(), loaded.model_hash);
        let actuator = pack_name(&name);
        // The state topic is opened first: a second twin is refused there.
        let state_writer = StateWriter::create(bus, &Topic::state(&name)?)?;
        let health_writer = HealthWriter::create(bus, &Topic::health(&name)?)?;
        let outputs = std::mem::take(&mut loaded.outputs)
            .into_iter()
            .map(|output| FieldOutput::start(bus, &name, model_hash, boot_id, output))
            .collect::<Result<_, WireError>>()?;
        let estimation = loaded
            .estimator
            .take()
            .map(|estimator| {
                let writer = EstimateWriter::create(bus, &Topic::estimate(&name)?)?;
                let estimate = Estimate { model_hash, boot_id, actuator, ..estimator.payload() };
                Ok::<_, WireError>(Estimation { estimator, writer, estimate })
            })
            .transpose()?;
        let reader = SensorReader::attach(bus, &Topic::sensor(loaded.spec.sensor())?)?;
        let evaluation = loaded.evaluation();
        let parts = Parts::new(loaded);
        let mut state = State { boot_id, actuator, ..State::default() };
        let mut health = Health { boot_id, actuator, ..Health::default() };
        parts.write_names(&mut state, &mut health);
        let record = Record::new(number, health_writer, health, events);
        let last_good_ns = record.start_ns();
        let deadline = Deadline::new(limits.deadline_ms);
        Ok(Self {
            reader,
            state_writer,
            outputs,
            evaluation,
            estimation,
            label: RegimeLabel { regime: RegimeKind::Free, held: false },
            validator: Validator::new(limits, parts.needed.clone()),
            waiting: VecDeque::with_capacity(parts.backlog),
            force_watch: ResidualWatch::default(),
            parts,
            limits,
            deadline,
            state,
            record,
            last_good_ns,
            has_answered: false,
            was_outside: false,
            next_deadline_ns: last_good_ns + deadline.ns(),
        })
    }

    /// Properties that its readers depend on.
    fn running(&self) -> RunningActuator<'_> {
        RunningActuator {
            name: self.state_writer.topic().actuator(),
            sensor: self.reader.topic().actuator(),
            outputs: self.outputs.iter().map(FieldOutput::shape).collect(),
            estimates: self.estimation.is_some(),
        }
    }

    /// Continues with another model; the caller has checked that names and shapes are the same.
    fn swap(&mut self, mut loaded: LoadedActuator, retired: &mut Retired) {
        let model_hash = loaded.model_hash;
        for (output, new) in self.outputs.iter_mut().zip(std::mem::take(&mut loaded.outputs)) {
            retired.reconstructors.push(output.swap(model_hash, new));
        }
        if let (Some(Estimation { estimator, estimate, .. }), Some(new)) =
            (&mut self.estimation, loaded.estimator.take())
        {
            // Estimates of another model or other priors do not apply.
            let Estimate { boot_id, actuator, seq, .. } = *estimate;
            *estimate = Estimate { model_hash, boot_id, actuator, seq, ..new.payload() };
            retired.estimators.push(std::mem::replace(estimator, new));
        }
        self.evaluation = loaded.evaluation();
        self.force_watch.restart();
        retired.parts.push(std::mem::replace(&mut self.parts, Parts::new(loaded)));
        self.validator.set_needed(self.parts.needed.clone());
        self.waiting.reserve(self.parts.backlog.saturating_sub(self.waiting.len()));
        self.parts.write_names(&mut self.state, &mut self.record.health);
    }

    /// When this actuator must be served again at the latest.
    fn next_due_ns(&self) -> u64 {
        self.next_deadline_ns.min(self.record.next_health_ns())
    }

    /// Takes the waiting readings, answers the newest good ones (one unless the scene has a backlog), then performs what is due
    /// by the clock.
    fn serve(&mut self) {
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
        if check.restarted {
            // Stamps of another run need not compare with those of the session.
            self.answer_waiting();
            self.parts.session.restart();
        }
        self.record.ingested(&sample, &check);
        let taken = match check.rejection {
            Some(outcome) => Err(outcome),
            None => {
                if self.parts.backlog > 1 && self.parts.session.answers_only_the_newest() {
                    self.answer_waiting();
                }
                let inputs = self.validator.inputs(&sample);
                self.parts.session.take(sample.t_sensor_ns, inputs).map_err(refused)
            }
        };
        match taken {
            Ok(filtered) => {
                if self.waiting.len() == self.parts.backlog {
                    self.waiting.pop_front();
                    self.record.record_outcome(Outcome::DroppedSuperseded);
                }
                if (filtered.has_new_past() || check.restarted)
                    && let Some(estimation) = &mut self.estimation
                {
                    estimation.estimator.forget_past();
                }
                self.waiting.push_back(WaitingReading { sample, taken_ns: now, filtered });
            }
            Err(outcome) => {
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
        while let Some(WaitingReading { sample, taken_ns, filtered }) = self.waiting.pop_front() {
            let outcome = match self.evaluate(&sample, filtered) {
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
    fn evaluate(&mut self, sample: &SensorSample, mut filtered: FilteredInputs) -> Result<(), Outcome> {
        let mut moving = None;
        if let Some(Estimation { estimator, estimate, .. }) = &mut self.estimation {
            let update = estimator.update(sample, &filtered.inputs, filtered.spread);
            estimator.fill(&update, estimate);
            filtered.inputs = Inputs::from(update.inputs);
            moving = estimator.evaluate_motion(&mut self.evaluation);
        }
        match moving {
            Some(_) => filtered.apply_to(&mut self.evaluation),
            None => {
                self.parts.session.answer(&filtered, &mut self.evaluation).map_err(refused)?;
            }
        }
        self.label = if self.parts.session.has_inertia() {
            RegimeLabel { regime: self.evaluation.regime, held: false }
        } else {
            self.parts.labels.next(&self.evaluation)
        };
        if let Some(Estimation { estimate, .. }) = &mut self.estimation {
            estimate.inputs = *self.evaluation.inputs.values();
            if self.evaluation.domain != DomainStatus::Inside {
                // The filter's deviations rest on derivatives of the model, whose errors are not known here.
                estimate.sigmas.fill(f64::NAN);
            }
        }
        if self.parts.wanted.coefficients || self.parts.contents.outputs.count() > 0 {
            self.parts.session.complete(&mut self.evaluation);
        }
        self.note_domain();
        if !publish::is_answer(&self.evaluation) {
            return Err(Outcome::DroppedModel);
        }
        match (self.evaluation.domain, self.limits.outside_domain) {
            (DomainStatus::Outside, OutsideDomain::Hold) => Err(Outcome::HeldOutsideDomain),
            (DomainStatus::Outside, OutsideDomain::Refuse) => Err(Outcome::DroppedOutsideDomain),
            _ => Ok(()),
        }
    }

    /// Tells the reporter when readings leave the training range or come back: which input, and by how much.
    fn note_domain(&mut self) {
        let is_outside = self.evaluation.flags.extrapolated;
        if is_outside == std::mem::replace(&mut self.was_outside, is_outside) {
            return;
        }
        if !is_outside {
            self.record.event(EventKind::Inside, 0);
            return;
        }
        let farthest = self.parts.session.evaluator().farthest_outside(&self.evaluation);
        let named = farthest.map(|(index, by)| (self.parts.contents.name(index), by));
        let (input, by) = named.unwrap_or(([0; 32], self.evaluation.domain_distance));
        self.record.outside(input, by);
    }

    /// Steps 4 and 5: sends the state, which waits for no field, then reconstructs each field into its loan and sends it.
    /// Returns the outcome of the reading.
    fn publish(&mut self, sample: &SensorSample, taken_ns: u64) -> Outcome {
        self.finish_state(sample, taken_ns);
        let mut outcome = if self.send_state() { Outcome::Published } else { Outcome::DroppedNotSent };
        self.send_estimate(sample);
        for output in self.outputs.iter_mut().filter(|output| output.is_due(sample.t_sensor_ns)) {
            self.parts.session.complete(&mut self.evaluation);
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
        let silence_ns = taken_ns.saturating_sub(self.last_good_ns);
        self.record.good(self.state.flags, silence_ns);
        if self.has_answered {
            self.deadline.take(silence_ns);
        }
        self.has_answered = true;
        self.last_good_ns = taken_ns;
        self.next_deadline_ns = taken_ns + self.deadline.ns();
        outcome
    }

    /// Fills the state from the evaluation and the reading, and counts what it shows.
    fn finish_state(&mut self, sample: &SensorSample, taken_ns: u64) {
        self.widen_by_estimate();
        let new = self.parts.used.new_in(sample);
        let watched = self.watch_residuals(sample, &new);
        let (regime_before, flags_before) = (self.state.regime, self.record.health.flags);
        self.fill_state(sample);
        let is_followed = self.follow(sample, &new);
        let is_late = taken_ns.saturating_sub(sample.t_sensor_ns) > ms_to_ns(self.limits.late_ms);
        let estimation = self.estimation.as_ref();
        let has_alarm =
            estimation.is_some_and(|estimation| estimation.estimate.alarm != estimate_alarm::NONE);
        for (bit, is_set) in [
            (flags::FORCE_MEASURED, sample.measured_force_n.is_finite()),
            (flags::FORCE_MISMATCH, watched.has_force_mismatch),
            (flags::MARKER_MISMATCH, watched.has_marker_mismatch),
            (flags::OBSERVABLE_MISMATCH, watched.has_observable_mismatch),
            (flags::ESTIMATE_ALARM, has_alarm),
            (flags::LATE, is_late),
            (flags::FOLLOWED, is_followed),
        ] {
            self.state.flags |= if is_set { bit } else { 0 };
        }
        self.record.health.late += u64::from(is_late);
        self.record.alarms(flags_before, self.state.flags);
        if regime_before != self.state.regime {
            self.record.event(EventKind::Regime, self.state.regime.into());
        }
    }

    /// Adds the errors of the estimated unknowns to the half-width of the force.
    fn widen_by_estimate(&mut self) {
        let Some(Estimation { estimator, estimate, .. }) = &mut self.estimation else { return };
        let evaluation = &mut self.evaluation;
        estimate.force_sigma_n = estimator.force_sigma_n(evaluation);
        let of_estimate_n = HALFWIDTH_SIGMAS * estimate.force_sigma_n;
        evaluation.halfwidths.force_n = evaluation.halfwidths.force_n.hypot(of_estimate_n);
        if evaluation.domain != DomainStatus::Inside {
            estimate.force_sigma_n = f64::NAN;
        }
    }

    /// Compares what was measured with the model's answer. Residuals that stay widen the half-widths.
    fn watch_residuals(&mut self, sample: &SensorSample, new: &NewValues) -> WatchedResiduals {
        let evaluation = &mut self.evaluation;
        let bias_n = self.estimation.as_ref().map_or(0.0, |estimation| estimation.estimator.force_bias_n());
        let residual = Residual {
            t_sensor_ns: sample.t_sensor_ns,
            value: sample.measured_force_n - bias_n - evaluation.contact_force_n,
            halfwidth: evaluation.halfwidths.force_n,
            sigma: self.parts.force_sigma_n,
        };
        let after_s = 1e-3 * self.limits.mismatch_ms;
        let force = self.force_watch.update(residual, after_s);
        let Parts { markers, observed, followed, contents, .. } = &mut self.parts;
        let markers = markers.as_mut().map(|watch| watch.update(sample, new, evaluation, after_s));
        let markers = markers.unwrap_or_default();
        let has_observable_mismatch = observed.update(sample, new, evaluation, &contents.outputs, after_s);
        let halfwidths = &mut evaluation.halfwidths;
        halfwidths.force_n = halfwidths.force_n.hypot(force.contribution);
        // The half-width of what is followed contains the scatter of its residuals already.
        if followed.is_none() {
            halfwidths.displacement_mm = halfwidths.displacement_mm.hypot(markers.contribution);
        }
        WatchedResiduals {
            has_force_mismatch: force.mismatch,
            has_marker_mismatch: markers.mismatch,
            has_observable_mismatch,
        }
    }

    /// Writes the offsets of the answer into the state, then lets the session follow what the reading measures, for the next answer. True if
    /// there were offsets.
    fn follow(&mut self, sample: &SensorSample, new: &NewValues) -> bool {
        let Parts { followed, contents, session, .. } = &mut self.parts;
        let Some(followed) = followed else { return false };
        for (at, offset) in self.state.observable_offsets.iter_mut().enumerate() {
            if let Some(output) = contents.outputs.learned_output(at) {
                *offset = session.offset(output);
            }
        }
        let has_offsets = session.has_followed();
        followed.follow(sample, new, &self.evaluation, session);
        has_offsets
    }

    /// Writes evaluation and reading into the state.
    fn fill_state(&mut self, sample: &SensorSample) {
        let state = &mut self.state;
        let Parts { contents, wanted, observed, followed, .. } = &self.parts;
        publish::fill_state(state, &self.evaluation, contents, *wanted);
        if followed.is_none() {
            observed.widen(&mut state.observable_halfwidths);
        }
        publish::fill_label(state, self.label);
        state.outcome = Outcome::Published.code();
        state.sensor_boot_id = sample.boot_id;
        state.sensor_seq = sample.seq;
        state.t_sensor_ns = sample.t_sensor_ns;
        state.measured_force_n = sample.measured_force_n;
    }

    /// Sends the present state with its age; a failure is counted.
    fn send_state(&mut self) -> bool {
        let now = now_ns();
        self.state.layout_version = LAYOUT_VERSION;
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
        let Some(Estimation { writer, estimate, .. }) = &mut self.estimation else { return };
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
        // Estimates come with readings only; new readers get the last one.
        if let Some(Estimation { writer, .. }) = &self.estimation
            && writer.serve_late_readers().is_err()
        {
            self.record.failed(EventKind::SendFailed);
        }
        self.next_deadline_ns = now + self.deadline.ns();
    }

    /// The counters so far.
    fn health(&self) -> &Health {
        &self.record.health
    }
}
