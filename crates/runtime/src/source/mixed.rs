//! Readings out of several sensors: on the pace of one of them, or of a clock, each value with its age.
//!
//! A value older than its sensor's limit is absent (NaN), flagged and counted. While the sensor that sets the pace is silent,
//! its age limit takes its place: a reading comes once in that time, with what the others say. Nothing is allocated after the
//! start.

use super::devices::Devices;
use super::reading::{
    BridgeWaker, InputNames, MARKERS, NAMED, PRESSURE, Poll, Reading, SLOTS, SensorCounters, Source, age_mut,
    bit, value_mut,
};
use super::sensor::{Answer, Inbox, Measured};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use wire::layout::AGES_MAX;
use wire::{SensorSample, now_ns};

/// Status of a reading whose pressure is too old, see [`wire::SensorSample::status`].
const PRESSURE_STALE: u32 = 256;

/// One sensor of the actuator.
#[derive(Debug)]
pub(super) struct Input {
    /// Its name in the scene.
    pub(super) name: String,
    pub(super) inbox: Inbox,
    /// Older values are absent.
    pub(super) age_limit_ns: u64,
    /// Taken out of the queue, but later than the last reading.
    pub(super) ahead: Option<Answer>,
}

impl Input {
    fn next(&mut self) -> Option<Answer> {
        self.ahead.take().or_else(|| self.inbox.queue.try_recv().ok())
    }
}

/// Time of an answer, ns.
fn t_ns(answer: &[Measured]) -> u64 {
    answer.first().map_or(0, |measured| measured.t_ns)
}

/// When a reading is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Pace {
    /// Whenever the sensor at this position says something.
    Sensor(usize),
    /// Period, ns.
    Period(u64),
}

#[derive(Debug)]
pub(super) struct Mixed {
    inputs: Vec<Input>,
    pace: Pace,
    devices: Devices,
    /// The newest value of each slot; `None` before the first answer.
    newest: [Option<Measured>; SLOTS],
    /// The parts of a reading that stay the same.
    template: SensorSample,
    start_ns: u64,
    /// Stamp of the last reading.
    last_ns: u64,
}

impl Mixed {
    pub(super) fn new(inputs: Vec<Input>, pace: Pace, names: &InputNames, devices: Devices) -> Self {
        let slots = inputs.iter().flat_map(|input| &input.inbox.slots);
        let last_marker = slots.filter(|slot| (MARKERS..NAMED).contains(*slot)).max();
        let marker_values = last_marker.map_or(0, |slot| (slot - MARKERS) as u32 / 3 * 3 + 3);
        let template = SensorSample { marker_values, age_count: AGES_MAX as u32, ..names.sample() };
        Self { inputs, pace, devices, newest: [None; SLOTS], template, start_ns: 0, last_ns: 0 }
    }

    fn take(&mut self, answer: &[Measured]) {
        for measured in answer {
            if let Some(newest) = self.newest.get_mut(measured.slot) {
                *newest = Some(*measured);
            }
        }
    }

    /// Takes the answers of all sensors until `until_ns`, except of the sensor that sets the pace.
    fn take_until(&mut self, until_ns: u64, pace: Option<usize>) {
        for position in (0..self.inputs.len()).filter(|position| Some(*position) != pace) {
            while let Some(answer) = self.inputs.get_mut(position).and_then(Input::next) {
                if t_ns(&answer) > until_ns {
                    if let Some(input) = self.inputs.get_mut(position) {
                        input.ahead = Some(answer);
                    }
                    break;
                }
                self.take(&answer);
            }
        }
    }

    /// The reading of `t_ns` from the newest values.
    fn merge(&mut self, t_ns: u64) -> Reading {
        let mut sample = SensorSample { t_sensor_ns: t_ns, ..self.template };
        for input in &self.inputs {
            let stale_before = sample.stale_values;
            for &slot in &input.inbox.slots {
                let newest = self.newest.get(slot).copied().flatten();
                let age_ns = t_ns.saturating_sub(newest.map_or(self.start_ns, |newest| newest.t_ns));
                // A marker is as old as its oldest coordinate.
                if let Some(oldest_ns) = age_mut(&mut sample, slot) {
                    *oldest_ns = (*oldest_ns).max(age_ns);
                }
                match newest.filter(|_| age_ns <= input.age_limit_ns) {
                    None => sample.stale_values |= bit(slot),
                    Some(newest) if newest.fault != 0 => sample.fault_values |= bit(slot),
                    Some(_) => {}
                }
            }
            let stale = u64::from(sample.stale_values != stale_before);
            input.inbox.counters.stale.fetch_add(stale, Ordering::Relaxed);
        }
        // All coordinates of a marker are present or absent together.
        let absent = sample.stale_values | sample.fault_values;
        for newest in self.newest.iter().flatten().filter(|newest| absent & bit(newest.slot) == 0) {
            if let Some(value) = value_mut(&mut sample, newest.slot) {
                *value = newest.value;
            }
        }
        let pressure = bit(PRESSURE);
        sample.status = match (sample.stale_values & pressure != 0, sample.fault_values & pressure != 0) {
            (true, _) => PRESSURE_STALE,
            (_, true) => self.newest.get(PRESSURE).copied().flatten().map_or(0, |newest| newest.fault),
            _ => 0,
        };
        sample.stale_total += u64::from(sample.stale_values.count_ones());
        (self.template.stale_total, self.last_ns) = (sample.stale_total, t_ns);
        Reading { sample, due_s: f64::NAN }
    }

    /// On the pace of a sensor: its next reading, or one without it when it has been silent for its age limit.
    fn next_of(&mut self, pace: usize, now_ns: u64) -> Option<Reading> {
        while let Some(answer) = self.inputs.get_mut(pace).and_then(Input::next) {
            let t_ns = t_ns(&answer);
            if t_ns < self.last_ns {
                // A later reading without it was made already: it counts from the next one on.
                self.take(&answer);
                continue;
            }
            self.take_until(t_ns, Some(pace));
            self.take(&answer);
            return Some(self.merge(t_ns));
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
        // Checked before the queues: a thread that has ended has delivered all its values.
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
#[path = "../../tests/unit/source_mixed.rs"]
mod tests;
