//! One actuator's way from reading to field: judge, evaluate, publish, count.

use super::check::Checker;
use super::histogram::Histogram;
use super::load::Loaded;
use super::output::Output;
use super::ring::{Event, EventKind, Ring};
use super::watch::ForceWatch;
use crate::config::{Limits, OutsideDomain, StateSpec, ms_to_ns};
use rom::evaluation::{Evaluation, Input};
use rom::hull::DomainStatus;
use rom::predict::Predictor;
use rom::regime::RegimeSwitch;
use rom::snapshots::RegimeKind;
use std::collections::VecDeque;
use std::sync::Arc;
use wire::layout::{COEFFICIENTS_MAX, GROUPS_MAX, VERSION, flags, pack_name, regime};
use wire::{
    Bus, Health, HealthWriter, Outcome, SensorReader, SensorSample, State, StateWriter, Topic, WireError,
    now_ns,
};

/// Interval of the health topic.
const HEALTH_NS: u64 = 1_000_000_000;

/// One actuator of a running twin.
#[derive(Debug)]
pub(super) struct ActuatorTwin {
    number: u32,
    pub(super) reader: SensorReader,
    state_writer: StateWriter,
    health_writer: HealthWriter,
    pub(super) outputs: Vec<Output>,
    evaluator: Predictor,
    evaluation: Evaluation,
    switch: RegimeSwitch,
    checker: Checker,
    /// Good readings taken from the queue and not answered yet, with the time of taking; never more than `backlog`.
    waiting: VecDeque<(SensorSample, u64)>,
    backlog: usize,
    force_watch: ForceWatch,
    group_sizes: Vec<(RegimeKind, [u8; GROUPS_MAX])>,
    wanted: StateSpec,
    limits: Limits,
    /// The last state, sent again with flags when readings are held or stay away.
    state: State,
    health: Health,
    latency: Histogram,
    compute: Histogram,
    start_ns: u64,
    /// When the last good reading was taken up; the start before there was one.
    last_good_ns: u64,
    next_deadline_ns: u64,
    next_health_ns: u64,
    received_at_last_health: u64,
    last_outcome: Outcome,
    transport_failures: u64,
    ring: Arc<Ring>,
}

impl ActuatorTwin {
    /// Becomes the twin of the actuator: opens its topics, reserves their memory.
    pub(super) fn start(
        bus: &Bus,
        number: u32,
        loaded: Loaded,
        limits: Limits,
        boot_id: u64,
        ring: Arc<Ring>,
    ) -> Result<Self, WireError> {
        let name = loaded.spec.name.clone();
        // The state topic comes first: it is the one that a second twin is refused at.
        let state_writer = StateWriter::create(bus, &Topic::state(&name)?)?;
        let health_writer = HealthWriter::create(bus, &Topic::health(&name)?)?;
        let outputs = loaded
            .outputs
            .into_iter()
            .map(|output| Output::start(bus, &name, loaded.model_hash, boot_id, output))
            .collect::<Result<_, WireError>>()?;
        let reader = SensorReader::attach(bus, &Topic::sensor(loaded.spec.sensor())?)?;
        let start_ns = now_ns();
        let packed = pack_name(&name);
        let model_hash = loaded.model_hash;
        Ok(Self {
            number,
            reader,
            state_writer,
            health_writer,
            outputs,
            evaluation: loaded.evaluator.evaluation(),
            evaluator: loaded.evaluator,
            switch: RegimeSwitch::default(),
            checker: Checker::new(limits, loaded.spec.gap_mm),
            waiting: VecDeque::with_capacity(loaded.spec.backlog),
            backlog: loaded.spec.backlog,
            force_watch: ForceWatch::default(),
            group_sizes: loaded.group_sizes.iter().map(|(kind, sizes)| (*kind, cut(sizes))).collect(),
            wanted: loaded.spec.state,
            limits,
            state: State { model_hash, boot_id, actuator: packed, ..State::default() },
            health: Health { model_hash, boot_id, actuator: packed, ..Health::default() },
            latency: Histogram::default(),
            compute: Histogram::default(),
            start_ns,
            last_good_ns: start_ns,
            next_deadline_ns: start_ns + ms_to_ns(limits.deadline_ms),
            next_health_ns: start_ns + HEALTH_NS,
            received_at_last_health: 0,
            last_outcome: Outcome::Published,
            transport_failures: 0,
            ring,
        })
    }

    /// Its name and that of the sensor it reads.
    pub(super) fn names(&self) -> (&str, &str) {
        (self.state_writer.topic().actuator(), self.reader.topic().actuator())
    }

    /// Field topics with the values of a sample.
    pub(super) fn shapes(&self) -> Vec<String> {
        let set = |output: &Output| output.topic().node_set().unwrap_or("all").to_owned();
        self.outputs.iter().map(|output| format!("{} ({})", set(output), output.entries())).collect()
    }

    /// Continues with another model; the caller has checked that names and shapes are the same.
    pub(super) fn swap(&mut self, loaded: Loaded, retired: &mut Vec<Predictor>) {
        self.evaluation = loaded.evaluator.evaluation();
        retired.push(std::mem::replace(&mut self.evaluator, loaded.evaluator));
        for (output, new) in self.outputs.iter_mut().zip(loaded.outputs) {
            retired.push(output.swap(loaded.model_hash, new));
        }
        self.switch = RegimeSwitch::default();
        self.checker.set_gap(loaded.spec.gap_mm);
        self.backlog = loaded.spec.backlog;
        self.waiting.reserve(self.backlog.saturating_sub(self.waiting.len()));
        self.group_sizes = loaded.group_sizes.iter().map(|(kind, sizes)| (*kind, cut(sizes))).collect();
        self.wanted = loaded.spec.state;
        self.state.model_hash = loaded.model_hash;
        self.health.model_hash = loaded.model_hash;
    }

    /// When this actuator wants to be looked at again at the latest.
    pub(super) fn next_due_ns(&self) -> u64 {
        self.next_deadline_ns.min(self.next_health_ns)
    }

    /// Takes all waiting readings, answers the newest good ones (one unless the scene says more), then does what is due
    /// by the clock.
    pub(super) fn turn(&mut self) {
        loop {
            match self.reader.next() {
                Ok(Some(sample)) => self.take(sample),
                Ok(None) => break,
                Err(_) => {
                    self.transport_failed();
                    break;
                }
            }
        }
        self.answer();
        let now = now_ns();
        if now >= self.next_deadline_ns {
            self.miss_deadline(now);
        }
        if now >= self.next_health_ns {
            self.send_health(now);
        }
    }

    fn take(&mut self, sample: SensorSample) {
        let now = now_ns();
        let verdict = self.checker.judge(&sample, now);
        self.health.received += 1;
        self.health.missed += verdict.missed;
        if verdict.missed > 0 {
            self.tell(EventKind::Missed, verdict.missed);
        }
        if verdict.restarted {
            self.health.sensor_restarts += u64::from(self.health.sensor_boot_id != 0);
            self.health.sensor_boot_id = sample.boot_id;
            self.tell(EventKind::SensorStarted, sample.boot_id);
        }
        match verdict.refused {
            None => {
                if self.waiting.len() == self.backlog {
                    self.waiting.pop_front();
                    self.end(Outcome::DroppedSuperseded);
                }
                self.waiting.push_back((sample, now));
            }
            Some(outcome) if outcome.is_held() => {
                // The readings before it are still good news, and must not be overtaken by the bad one.
                self.answer();
                self.end(outcome);
                self.hold(outcome, now);
            }
            Some(outcome) => self.end(outcome),
        }
    }

    fn answer(&mut self) {
        while let Some((sample, taken_ns)) = self.waiting.pop_front() {
            self.process(&sample, taken_ns);
        }
    }

    fn process(&mut self, sample: &SensorSample, taken_ns: u64) {
        let gap_mm = self.checker.gap_mm(sample);
        let input = Input { pressure_mpa: sample.pressure_mpa, gap_mm };
        self.evaluator.evaluate(input, &mut self.switch, &mut self.evaluation);
        let evaluation = &self.evaluation;
        let finite =
            evaluation.contact_force_n.is_finite() && evaluation.coefficients.iter().all(|a| a.is_finite());
        if !finite {
            self.end(Outcome::DroppedModel);
            return;
        }
        if self.evaluation.domain == DomainStatus::Outside && self.left_out(taken_ns) {
            return;
        }
        let (before, flags_before) = (self.state.regime, self.health.flags);
        self.describe(sample, taken_ns);
        let alarm = self.state.flags & flags::FORCE_MISMATCH;
        if alarm != flags_before & flags::FORCE_MISMATCH {
            self.tell(EventKind::ForceMismatch, u64::from(alarm != 0));
        }
        if before != self.state.regime {
            self.tell(EventKind::Regime, u64::from(self.state.regime));
        }
        let mut sent = self.send_state();
        let due_ns = sample.t_sensor_ns;
        for output in self.outputs.iter_mut().filter(|output| output.is_due(due_ns)) {
            match output.publish(&self.evaluation, &self.state) {
                Ok(()) => self.health.fields_sent += 1,
                Err(_) => sent = false,
            }
        }
        let done_ns = now_ns();
        self.latency.add(done_ns.saturating_sub(sample.t_sensor_ns));
        self.compute.add(done_ns.saturating_sub(taken_ns));
        if !sent {
            self.transport_failed();
        }
        self.end(if sent { Outcome::Published } else { Outcome::DroppedNotSent });
        self.refresh(taken_ns);
        // Off the critical path: the next samples are on loan before the next reading comes.
        self.outputs.iter_mut().for_each(Output::loan_ahead);
    }

    /// A reading outside the domain that the settings do not want answered is ended here.
    fn left_out(&mut self, now: u64) -> bool {
        match self.limits.outside_domain {
            OutsideDomain::Answer => return false,
            OutsideDomain::Hold => {
                self.end(Outcome::HeldOutsideDomain);
                self.hold(Outcome::HeldOutsideDomain, now);
            }
            OutsideDomain::Refuse => self.end(Outcome::DroppedOutsideDomain),
        }
        true
    }

    /// Fills the state from the evaluation.
    fn describe(&mut self, sample: &SensorSample, now: u64) {
        let e = &self.evaluation;
        let state = &mut self.state;
        let gradient = |value: f64| if self.wanted.gradients { value } else { f64::NAN };
        let bar = |value: f64| if self.wanted.bars { value as f32 } else { f32::NAN };
        let age_ns = now.saturating_sub(sample.t_sensor_ns);
        state.flags = 0;
        state.outcome = Outcome::Published.code();
        state.sensor_boot_id = sample.boot_id;
        state.sensor_seq = sample.seq;
        state.t_sensor_ns = sample.t_sensor_ns;
        state.pressure_mpa = e.input.pressure_mpa;
        state.gap_mm = e.input.gap_mm;
        state.contact_force_n = e.contact_force_n;
        state.force_by_pressure_n_per_mpa = gradient(e.dforce_dpressure);
        state.force_by_gap_n_per_mm = gradient(e.dforce_dgap);
        state.onset_pressure_mpa = e.onset_pressure_mpa.unwrap_or(f64::INFINITY);
        state.measured_force_n = sample.measured_force_n;
        state.force_halfwidth_n = bar(e.bars.force_n);
        state.displacement_halfwidth_mm = bar(e.bars.displacement_mm);
        state.von_mises_halfwidth_mpa = bar(e.bars.stress_mpa);
        state.domain_distance = e.domain_distance as f32;
        state.regime = regime_number(e.regime);
        state.domain_status = match e.domain {
            DomainStatus::Inside => 0,
            DomainStatus::Near => 1,
            DomainStatus::Outside => 2,
        };
        state.coefficient_count = e.coefficients.len().min(COEFFICIENTS_MAX) as u32;
        state.coefficients = [0.0; COEFFICIENTS_MAX];
        for (to, from) in state.coefficients.iter_mut().zip(&e.coefficients) {
            *to = *from as f32;
        }
        let sizes = self.group_sizes.iter().find(|(kind, _)| *kind == e.basis);
        state.group_sizes = sizes.map(|(_, sizes)| *sizes).unwrap_or_default();
        let measured = sample.measured_force_n.is_finite();
        let after_ns = ms_to_ns(self.limits.force_mismatch_ms);
        let residual_n = sample.measured_force_n - e.contact_force_n;
        let mismatch = self.force_watch.update(sample.t_sensor_ns, residual_n, e.bars.force_n, after_ns);
        for (bit, set) in [
            (flags::NEAR_EDGE, e.domain == DomainStatus::Near),
            (flags::OUTSIDE_DOMAIN, e.domain == DomainStatus::Outside),
            (flags::FORCE_MEASURED, measured),
            (flags::FORCE_MISMATCH, mismatch),
            (flags::LATE, age_ns > ms_to_ns(self.limits.late_ms)),
            (flags::COEFFICIENTS_CUT, e.coefficients.len() > COEFFICIENTS_MAX),
            (flags::FORCE_CLAMPED, e.flags.force_clamped),
            (flags::REGIME_HELD, e.flags.held_by_hysteresis),
        ] {
            state.flags |= if set { bit } else { 0 };
        }
        self.health.late += u64::from(state.flags & flags::LATE != 0);
    }

    fn send_state(&mut self) -> bool {
        let now = now_ns();
        self.state.layout_version = VERSION;
        self.state.seq += 1;
        self.state.t_publish_ns = now;
        self.state.age_ns = match self.state.t_sensor_ns {
            0 => now.saturating_sub(self.start_ns),
            t_sensor_ns => now.saturating_sub(t_sensor_ns),
        };
        let sent = self.state_writer.publish(self.state).is_ok();
        self.health.states_sent += u64::from(sent);
        sent
    }

    /// The last good values again, marked as held, with the reason.
    fn hold(&mut self, outcome: Outcome, now: u64) {
        self.state.flags |= flags::HELD;
        self.state.outcome = outcome.code();
        if now >= self.next_deadline_ns {
            return; // the stale state that is sent now says both
        }
        if !self.send_state() {
            self.transport_failed();
        }
    }

    /// A good reading came: the deadline begins anew.
    fn refresh(&mut self, now: u64) {
        if self.health.flags & flags::STALE != 0 {
            self.tell(EventKind::Fresh, now.saturating_sub(self.last_good_ns));
        }
        self.health.flags = self.state.flags;
        self.last_good_ns = now;
        self.next_deadline_ns = now + ms_to_ns(self.limits.deadline_ms);
    }

    /// No good reading within the deadline: say so on the state topic, once every deadline, with the growing age.
    fn miss_deadline(&mut self, now: u64) {
        if self.state.flags & flags::STALE == 0 {
            self.health.deadline_misses += 1;
            self.tell(EventKind::Stale, now.saturating_sub(self.last_good_ns));
        }
        self.state.flags |= flags::STALE;
        self.health.flags = self.state.flags;
        if !self.send_state() {
            self.transport_failed();
        }
        self.next_deadline_ns = now + ms_to_ns(self.limits.deadline_ms);
    }

    fn send_health(&mut self, now: u64) {
        let health = &mut self.health;
        let interval_ns = now.saturating_sub(self.next_health_ns) + HEALTH_NS;
        health.seq += 1;
        health.t_publish_ns = now;
        health.uptime_ns = now.saturating_sub(self.start_ns);
        health.age_ns = now.saturating_sub(self.last_good_ns);
        health.log_lost = self.ring.lost();
        health.rate_hz = (health.received - self.received_at_last_health) as f64 * 1e9 / interval_ns as f64;
        health.latency_p50_ns = self.latency.quantile(0.5);
        health.latency_p99_ns = self.latency.quantile(0.99);
        health.latency_max_ns = self.latency.max();
        health.compute_p50_ns = self.compute.quantile(0.5);
        health.compute_p99_ns = self.compute.quantile(0.99);
        health.compute_max_ns = self.compute.max();
        self.received_at_last_health = health.received;
        let sent = self.health_writer.publish(self.health).is_ok();
        self.latency.clear();
        self.compute.clear();
        self.next_health_ns = now + HEALTH_NS;
        if !sent {
            self.transport_failed();
        }
    }

    /// The one place where a reading ends.
    fn end(&mut self, outcome: Outcome) {
        if let Some(count) = self.health.outcomes.get_mut(outcome.code() as usize) {
            *count += 1;
        }
        // A superseded reading is the ordinary fate of a burst and no news.
        if outcome != self.last_outcome && outcome != Outcome::DroppedSuperseded {
            self.last_outcome = outcome;
            self.tell(EventKind::Outcome, outcome.code().into());
        }
    }

    pub(super) fn transport_failed(&mut self) {
        self.transport_failures += 1;
        if self.transport_failures.is_power_of_two() {
            self.tell(EventKind::TransportFailed, self.transport_failures);
        }
    }

    fn tell(&self, kind: EventKind, value: u64) {
        self.ring.push(Event { t_ns: now_ns(), actuator: self.number, kind, value });
    }

    /// Counters and last state, for the summary at the end.
    pub(super) fn health(&self) -> &Health {
        &self.health
    }
}

pub(crate) fn regime_number(kind: RegimeKind) -> u32 {
    match kind {
        RegimeKind::Free => regime::FREE,
        RegimeKind::Contact => regime::CONTACT,
    }
}

fn cut(sizes: &[u8]) -> [u8; GROUPS_MAX] {
    let mut out = [0; GROUPS_MAX];
    for (to, from) in out.iter_mut().zip(sizes) {
        *to = *from;
    }
    out
}
