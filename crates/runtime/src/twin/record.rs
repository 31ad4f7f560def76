//! Counters, latencies, failures and alarms of a twin. They leave the loop through the health topic and the event channel.

use super::ingest::SampleCheck;
use crate::{latency, service};
use hdrhistogram::Histogram;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use wire::layout::flags;
use wire::{Health, HealthWriter, Outcome, SensorSample, now_ns};

/// Interval of the health topic, ns.
const HEALTH_NS: u64 = 1_000_000_000;
/// Time from the first reading of a bridge to the next health: the bridge reports from it whether its readings are used.
const FIRST_HEALTH_NS: u64 = 500_000_000;

/// The counters of one actuator.
#[derive(Debug)]
pub(super) struct Record {
    /// Place of the actuator in the scene.
    actuator: u32,
    pub(super) health: Health,
    writer: HealthWriter,
    latency: Histogram<u32>,
    compute: Histogram<u32>,
    start_ns: u64,
    last_health_ns: u64,
    next_health_ns: u64,
    received_at_last_health: u64,
    last_outcome: Outcome,
    failures: [u64; EventKind::COUNT],
    events: EventSender,
}

impl Record {
    pub(super) fn new(actuator: u32, writer: HealthWriter, health: Health, events: EventSender) -> Self {
        let start_ns = now_ns();
        Self {
            actuator,
            health,
            writer,
            latency: latency::histogram(),
            compute: latency::histogram(),
            start_ns,
            last_health_ns: start_ns,
            next_health_ns: start_ns + HEALTH_NS,
            received_at_last_health: 0,
            last_outcome: Outcome::Published,
            failures: [0; EventKind::COUNT],
            events,
        }
    }

    /// Start of the twin.
    pub(super) fn start_ns(&self) -> u64 {
        self.start_ns
    }

    /// When the next health is due.
    pub(super) fn next_health_ns(&self) -> u64 {
        self.next_health_ns
    }

    /// Counts a reading that was taken from the sensor topic.
    pub(super) fn ingested(&mut self, sample: &SensorSample, check: &SampleCheck) {
        self.health.received += 1;
        self.health.missed = self.health.missed.saturating_add(check.missed);
        if check.missed > 0 {
            self.event(EventKind::Missed, check.missed);
        }
        if check.restarted {
            self.health.sensor_restarts += u64::from(self.health.sensor_boot_id != 0);
            self.health.sensor_boot_id = sample.boot_id;
            self.next_health_ns = self.next_health_ns.min(now_ns() + FIRST_HEALTH_NS);
            self.event(EventKind::SensorStarted, sample.boot_id);
        }
    }

    /// Counts the end of a reading. Every reading comes here exactly once, after its outputs.
    pub(super) fn record_outcome(&mut self, outcome: Outcome) {
        if let Some(count) = self.health.outcomes.get_mut(outcome.code() as usize) {
            *count += 1;
        }
        // Superseded readings are usual in a burst and not worth an event.
        if outcome != self.last_outcome && outcome != Outcome::DroppedSuperseded {
            self.last_outcome = outcome;
            self.event(EventKind::Outcome, outcome.code().into());
        }
    }

    /// Counts the time from stamp to sent, and from taking the reading to sent.
    pub(super) fn answered(&mut self, sample: &SensorSample, taken_ns: u64) {
        let done_ns = now_ns();
        self.latency.saturating_record(done_ns.saturating_sub(sample.t_sensor_ns));
        self.compute.saturating_record(done_ns.saturating_sub(taken_ns));
    }

    /// A good reading was answered with a state that has these flags.
    pub(super) fn good(&mut self, state_flags: u32, silence_ns: u64) {
        if self.health.flags & flags::STALE != 0 {
            self.event(EventKind::Fresh, silence_ns);
        }
        self.health.flags = state_flags;
    }

    /// Counts a failure of this kind; reports it when the count is a power of two.
    pub(super) fn failed(&mut self, kind: EventKind) {
        let Some(count) = self.failures.get_mut(kind as usize) else { return };
        *count += 1;
        let count = *count;
        if count.is_power_of_two() {
            self.event(kind, count);
        }
    }

    /// Hands an event to the reporter.
    pub(super) fn event(&self, kind: EventKind, value: u64) {
        self.events.send(Event { t_ns: now_ns(), actuator: self.actuator, kind, value, input: [0; 32] });
    }

    /// Readings are outside the training range now: by how much, of the input of this packed name.
    pub(super) fn outside(&self, input: [u8; 32], by: f64) {
        let (actuator, kind) = (self.actuator, EventKind::Outside);
        self.events.send(Event { t_ns: now_ns(), actuator, kind, value: by.to_bits(), input });
    }

    /// Hands the alarms that rose or fell to the reporter.
    pub(super) fn alarms(&self, before: u32, now: u32) {
        let alarms = [
            (flags::FORCE_MISMATCH, EventKind::ForceMismatch),
            (flags::MARKER_MISMATCH, EventKind::MarkerMismatch),
            (flags::OBSERVABLE_MISMATCH, EventKind::ObservableMismatch),
            (flags::ESTIMATE_ALARM, EventKind::EstimateAlarm),
            (flags::SNAPPED, EventKind::Snapped),
        ];
        for (bit, kind) in alarms.into_iter().filter(|(bit, _)| (before ^ now) & bit != 0) {
            self.event(kind, u64::from(now & bit != 0));
        }
    }

    /// Sends the health when it is due.
    pub(super) fn send_health(&mut self, now: u64, last_good_ns: u64) {
        if now < self.next_health_ns {
            return;
        }
        let health = &mut self.health;
        let interval_ns = now.saturating_sub(self.last_health_ns).max(1);
        health.seq += 1;
        health.t_publish_ns = now;
        health.uptime_ns = now.saturating_sub(self.start_ns);
        health.age_ns = now.saturating_sub(last_good_ns);
        health.log_lost = self.events.lost() + service::lost_log_lines();
        health.rate_hz = (health.received - self.received_at_last_health) as f64 * 1e9 / interval_ns as f64;
        health.latency_p50_ns = self.latency.value_at_quantile(0.5);
        health.latency_p99_ns = self.latency.value_at_quantile(0.99);
        health.latency_max_ns = self.latency.max();
        health.compute_p50_ns = self.compute.value_at_quantile(0.5);
        health.compute_p99_ns = self.compute.value_at_quantile(0.99);
        health.compute_max_ns = self.compute.max();
        self.received_at_last_health = health.received;
        let sent = self.writer.publish(self.health).is_ok();
        self.latency.reset();
        self.compute.reset();
        (self.last_health_ns, self.next_health_ns) = (now, now + HEALTH_NS);
        if !sent {
            self.failed(EventKind::SendFailed);
        }
    }
}

/// A change that belongs in the log. Repetitions are not sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Event {
    /// When, see [`wire::now_ns`].
    pub t_ns: u64,
    /// Which actuator, by its place in the scene.
    pub actuator: u32,
    pub kind: EventKind,
    /// Its number, see [`EventKind`].
    pub value: u64,
    /// Packed name of the input that it is about; empty for most kinds.
    pub input: [u8; 32],
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum EventKind {
    /// Readings now end otherwise than before; value: [`wire::Outcome::code`].
    Outcome,
    /// The regime changed; value: its number.
    Regime,
    /// No good reading within the deadline; value: age of the last one, ns.
    Stale,
    /// Good readings again; value: how long there were none, ns.
    Fresh,
    /// The bridge was started or restarted; value: its boot id.
    SensorStarted,
    /// Readings never arrived; value: how many.
    Missed,
    /// The measured force contradicts the predicted one, or agrees again; value: 1 contradicts, 0 agrees.
    ForceMismatch,
    /// A marker contradicts its predicted position, or all agree again; value as of the force.
    MarkerMismatch,
    /// A measured observable contradicts its predicted value (1), or agrees again (0).
    ObservableMismatch,
    /// The estimate has an alarm (1), or none any more (0).
    EstimateAlarm,
    /// The pressure passed a limit and the state is behind it (1), or on the first branch again (0).
    Snapped,
    /// Readings are outside the training range; value: bits of the number by which the named input is, which is below 0 under the smallest
    /// trained value. Without a name the inputs together are, and the number is their distance as a fraction of the range.
    Outside,
    /// Readings are inside the training range again.
    Inside,
    /// Readings could not be received; value: failures of this kind so far, as for all that follow.
    ReceiveFailed,
    /// A state, field or health could not be sent.
    SendFailed,
    /// The model gave no field for an evaluation.
    ReconstructionFailed,
    /// The wait for readings failed.
    WaitFailed,
}

impl EventKind {
    pub(super) const COUNT: usize = Self::WaitFailed as usize + 1;
}

/// Events that wait for the reporter, at most; more are counted as lost.
const CAPACITY: usize = 1024;

/// The loop's end of the channel. The channel is allocated at the start and never blocks: sending takes a few
/// atomic operations.
#[derive(Debug, Clone)]
pub struct EventSender {
    events: SyncSender<Event>,
    lost: Arc<AtomicU64>,
}

/// A channel from the loop to the reporter, who must not wait in it (`try_recv`).
pub fn event_channel() -> (EventSender, Receiver<Event>) {
    let (events, receiver) = sync_channel(CAPACITY);
    (EventSender { events, lost: Arc::default() }, receiver)
}

impl EventSender {
    /// Sends an event, or counts it as lost when the reporter is behind.
    pub(super) fn send(&self, event: Event) {
        if self.events.try_send(event).is_err() {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Events lost so far.
    pub(super) fn lost(&self) -> u64 {
        self.lost.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
#[path = "../../tests/unit/twin_record.rs"]
mod tests;
