//! Readings out of several sensors: on the pace of one of them, or of a clock, each value with its age.
//!
//! A value older than its sensor's limit is absent (NaN), flagged and counted. While the sensor that sets the pace is silent,
//! its age limit takes its place: a reading comes once in that time, with what the others say. Nothing is allocated after the
//! start.

use super::devices::Devices;
use super::feed::Inbox;
use crate::source::named::InputNames;
use crate::source::reading::{BridgeWaker, Poll, Reading, SensorCounters, Source};
use crate::source::value::{FORCE, GAP, GROUPS, MARKERS, NAMED, PRESSURE, SLOTS, Update, group};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use wire::layout::{AGES_MAX, MARKERS_MAX, PARAMETERS_MAX};
use wire::now_ns;

/// Status of a reading whose pressure is too old, see [`wire::SensorSample::status`].
const PRESSURE_STALE: u32 = 256;

/// A sensor with the newest that it has said.
#[derive(Debug)]
pub(super) struct Input {
    /// Its name in the scene.
    pub(super) name: String,
    pub(super) inbox: Inbox,
    /// Older values are absent; `u64::MAX`: no value is too old.
    pub(super) age_limit_ns: u64,
    /// Taken out of the queue, but later than the reading that was made last.
    pub(super) ahead: Option<Update>,
}

impl Input {
    fn next(&mut self) -> Option<Update> {
        self.ahead.take().or_else(|| self.inbox.queue.try_recv().ok())
    }
}

/// When a reading is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Pace {
    /// Whenever the sensor at this position says something.
    Sensor(usize),
    /// Every so many ns.
    Period(u64),
}

/// The source.
#[derive(Debug)]
pub(super) struct Mixed {
    inputs: Vec<Input>,
    pace: Pace,
    /// Whether readings carry ages: not those of a single source.
    with_ages: bool,
    names: InputNames,
    devices: Devices,
    newest: Newest,
    marker_values: u32,
    start_ns: u64,
    /// Stamp of the last reading.
    last_ns: u64,
    stale_total: u64,
}

/// The newest of each value.
#[derive(Debug)]
struct Newest {
    values: [f64; SLOTS],
    t_ns: [u64; SLOTS],
    codes: [u32; SLOTS],
    /// Bit `slot`: said at least once.
    said: u64,
    faulty: u64,
}

impl Newest {
    fn take(&mut self, update: &Update) {
        for slot in (0..SLOTS).filter(|slot| update.which >> slot & 1 == 1) {
            let faulty = update.faulty >> slot & 1;
            self.faulty = self.faulty & !(1 << slot) | faulty << slot;
            let places = (self.values.get_mut(slot), self.t_ns.get_mut(slot), self.codes.get_mut(slot));
            if let (Some(value), Some(t_ns), Some(code)) = places {
                *value = update.values.get(slot).copied().unwrap_or(f64::NAN);
                (*t_ns, *code) = (update.t_ns, if faulty == 1 { update.code } else { 0 });
            }
        }
        self.said |= update.which;
    }
}

impl Mixed {
    pub(super) fn new(
        inputs: Vec<Input>,
        pace: Pace,
        with_ages: bool,
        names: InputNames,
        devices: Devices,
    ) -> Self {
        let slots = inputs.iter().fold(0, |slots, input| slots | input.inbox.slots);
        let last = (MARKERS..NAMED).filter(|slot| slots >> slot & 1 == 1).map(group).max();
        let newest =
            Newest { values: [f64::NAN; SLOTS], t_ns: [0; SLOTS], codes: [0; SLOTS], said: 0, faulty: 0 };
        Self {
            inputs,
            pace,
            with_ages,
            names,
            devices,
            newest,
            marker_values: last.map_or(0, |group| 3 * (group - MARKERS) as u32 + 3),
            start_ns: 0,
            last_ns: 0,
            stale_total: 0,
        }
    }

    /// A single device as a source: a reading for each of its answers, none while it is silent.
    pub(super) fn single(inbox: Inbox, devices: &Devices) -> Box<dyn Source> {
        let input = Input { name: String::new(), inbox, age_limit_ns: u64::MAX, ahead: None };
        Box::new(Self::new(vec![input], Pace::Sensor(0), false, InputNames::default(), devices.clone()))
    }

    /// Takes what the sensors have said until `t_ns`, but for the sensor that sets the pace.
    fn take_until(&mut self, t_ns: u64, pace: Option<usize>) {
        let Self { inputs, newest, .. } = self;
        for (_, input) in inputs.iter_mut().enumerate().filter(|(position, _)| Some(*position) != pace) {
            while let Some(update) = input.next() {
                if update.t_ns > t_ns {
                    input.ahead = Some(update);
                    break;
                }
                newest.take(&update);
            }
        }
    }

    /// The reading of `t_ns` from the newest values.
    fn merge(&mut self, t_ns: u64) -> Reading {
        let mut reading =
            Reading { t_sensor_ns: t_ns, marker_values: self.marker_values, ..Reading::default() };
        let Self { inputs, newest, .. } = self;
        let mut values = newest.values;
        let mut ages = [0u64; GROUPS];
        for input in inputs {
            let stale_before = reading.stale_values;
            for slot in (0..SLOTS).filter(|slot| input.inbox.slots >> slot & 1 == 1) {
                let was_said = newest.said >> slot & 1 == 1;
                let since = if was_said { newest.t_ns.get(slot).copied() } else { Some(self.start_ns) };
                let age_ns = t_ns.saturating_sub(since.unwrap_or(t_ns));
                let bit = 1 << group(slot);
                if let Some(oldest) = ages.get_mut(group(slot)) {
                    *oldest = (*oldest).max(age_ns);
                }
                if age_ns > input.age_limit_ns || (!was_said && self.with_ages) {
                    reading.stale_values |= bit;
                } else if newest.faulty >> slot & 1 == 1 {
                    reading.fault_values |= bit;
                }
            }
            let stale = u64::from(reading.stale_values != stale_before);
            input.inbox.counters.stale.fetch_add(stale, Ordering::Relaxed);
        }
        // A marker is seen as a whole or not at all.
        let absent = reading.stale_values | reading.fault_values;
        for (slot, value) in values.iter_mut().enumerate() {
            if absent >> group(slot) & 1 == 1 {
                *value = f64::NAN;
            }
        }
        self.stale_total += u64::from(reading.stale_values.count_ones());
        let value = |slot: usize| values.get(slot).copied().unwrap_or(f64::NAN);
        reading.pressure_mpa = value(PRESSURE);
        reading.gap_mm = value(GAP);
        reading.measured_force_n = value(FORCE);
        reading.markers_mm = std::array::from_fn::<f64, { 3 * MARKERS_MAX }, _>(|at| value(MARKERS + at));
        reading.status = match (reading.stale_values & 1, reading.fault_values & 1) {
            (1, _) => PRESSURE_STALE,
            (_, 1) => newest.codes.get(PRESSURE).copied().unwrap_or(0),
            _ => 0,
        };
        reading.inputs = std::array::from_fn::<f64, PARAMETERS_MAX, _>(|at| value(NAMED + at));
        if self.with_ages {
            reading.age_count = AGES_MAX as u32;
            reading.ages_ns.iter_mut().zip(&ages).for_each(|(to, from)| *to = *from);
            let of_inputs = ages.iter().skip(AGES_MAX);
            reading.input_ages_ns.iter_mut().zip(of_inputs).for_each(|(to, from)| *to = *from);
            reading.stale_total = self.stale_total;
        }
        self.last_ns = t_ns;
        self.names.name(reading)
    }

    /// On the pace of a sensor: its next reading, or one without it when it has been silent for its age limit.
    fn next_of(&mut self, pace: usize, now_ns: u64) -> Option<Reading> {
        while let Some(update) = self.inputs.get_mut(pace).and_then(Input::next) {
            if update.t_ns < self.last_ns {
                // A reading without it was made meanwhile: it counts from the next one on.
                self.newest.take(&update);
                continue;
            }
            self.take_until(update.t_ns, Some(pace));
            self.newest.take(&update);
            return Some(self.merge(update.t_ns));
        }
        (now_ns >= self.due_ns(pace)).then(|| {
            self.take_until(now_ns, None);
            self.merge(now_ns)
        })
    }

    /// When a reading is made without the sensor that sets the pace.
    fn due_ns(&self, pace: usize) -> u64 {
        let limit = self.inputs.get(pace).map_or(u64::MAX, |input| input.age_limit_ns);
        self.last_ns.max(self.start_ns).saturating_add(limit)
    }

    /// Why nothing more will come, if that is so.
    fn end(&self) -> Option<Poll> {
        let ended = || self.inputs.iter().filter_map(|input| input.inbox.ended.get());
        if let Some(panic) = ended().flatten().next() {
            return Some(Poll::Failed(panic.clone()));
        }
        (ended().count() == self.inputs.len()).then_some(Poll::End)
    }
}

impl Source for Mixed {
    fn start(&mut self, waker: &BridgeWaker) -> std::io::Result<()> {
        self.start_ns = now_ns();
        self.last_ns = self.start_ns;
        self.devices.start(Some(waker))
    }

    fn poll(&mut self, elapsed_s: f64) -> Poll {
        // Looked at before the queues: a thread that has ended has handed over all that it had.
        let end = self.end();
        let now = now_ns();
        let (reading, due_ns) = match self.pace {
            Pace::Sensor(pace) => (self.next_of(pace, now), self.due_ns(pace)),
            Pace::Period(period_ns) if now >= self.last_ns.saturating_add(period_ns) => {
                // Ticks that were missed are not made up for.
                let due = self.last_ns + (now - self.last_ns) / period_ns * period_ns;
                self.take_until(due, None);
                (Some(self.merge(due)), due.saturating_add(period_ns))
            }
            Pace::Period(period_ns) => (None, self.last_ns.saturating_add(period_ns)),
        };
        match (reading, end) {
            (Some(reading), _) => Poll::Reading(reading),
            (None, Some(end)) => end,
            (None, None) if due_ns == u64::MAX => Poll::Waiting { until_s: f64::INFINITY },
            (None, None) => Poll::Waiting { until_s: elapsed_s + due_ns.saturating_sub(now) as f64 * 1e-9 },
        }
    }

    fn devices(&self) -> Vec<(String, Arc<SensorCounters>)> {
        self.inputs.iter().map(|input| (input.name.clone(), input.inbox.counters.clone())).collect()
    }
}

#[cfg(test)]
#[path = "../../../tests/unit/source_sensor_mixed.rs"]
mod tests;
