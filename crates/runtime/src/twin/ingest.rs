//! Validation of a reading before anything is computed from it.

use crate::config::{Gap, Limits, ms_to_ns};
use wire::{Outcome, SensorSample, State};

/// Most sequence numbers between two readings; more is a fault of the later one.
const MAX_JUMP: u64 = 65_536;
/// So many readings in a row that agree with each other, and not with what came before, begin a new order: one wrong number
/// must not make all later readings look old.
const NEW_ORDER: u64 = 3;

/// Validates readings in their order: keeps run, sequence and time of the last one.
#[derive(Debug, Clone)]
pub(super) struct Validator {
    limits: Limits,
    gap: Gap,
    boot_id: u64,
    last_seq: u64,
    last_t_sensor_ns: u64,
    /// The last reading out of order, and how many there are in a row with it.
    out_of_order: (u64, u64),
}

/// The result of validating one reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct SampleCheck {
    /// Why it is not used; `None`: it is.
    pub rejection: Option<Outcome>,
    /// Readings that never arrived before this one.
    pub missed: u64,
    /// The bridge was started anew (also the first reading ever).
    pub restarted: bool,
}

impl Validator {
    pub(super) fn new(limits: Limits, gap: Gap) -> Self {
        Self { limits, gap, boot_id: 0, last_seq: 0, last_t_sensor_ns: 0, out_of_order: (0, 0) }
    }

    /// Continues with another gap; what came before stays known.
    pub(super) fn set_gap(&mut self, gap: Gap) {
        self.gap = gap;
    }

    /// Continues behind the reading of this state, which another twin answered.
    pub(super) fn continue_after(&mut self, last: &State) {
        self.boot_id = last.sensor_boot_id;
        self.last_seq = last.sensor_seq;
        self.last_t_sensor_ns = last.t_sensor_ns;
    }

    /// Validates `sample`, which arrived at `now_ns`, and remembers it.
    pub(super) fn validate(&mut self, sample: &SensorSample, now_ns: u64) -> SampleCheck {
        let restarted = sample.boot_id != self.boot_id;
        if restarted {
            self.boot_id = sample.boot_id;
            self.last_seq = sample.seq.wrapping_sub(1); // what an earlier run sent is not missing from this one
            self.last_t_sensor_ns = 0;
            self.out_of_order = (0, 0);
        }
        let check = |rejection, missed| SampleCheck { rejection, missed, restarted };
        let missed = match self.order(sample) {
            Ok(missed) => missed,
            Err(outcome) => return check(Some(outcome), 0),
        };
        self.last_seq = sample.seq;
        let rejection = self.rejection(sample, now_ns);
        // A stamp from the future must not make all later readings look old.
        if rejection != Some(Outcome::HeldFuture) {
            self.last_t_sensor_ns = sample.t_sensor_ns;
        }
        check(rejection, missed)
    }

    /// Readings that are missing before this one; an error when it does not follow the last one.
    fn order(&mut self, sample: &SensorSample) -> Result<u64, Outcome> {
        let step = sample.seq.wrapping_sub(self.last_seq);
        let outcome = if step == 0 {
            return Err(Outcome::DroppedDuplicate);
        } else if sample.t_sensor_ns < self.last_t_sensor_ns {
            return Err(Outcome::DroppedBackInTime);
        } else if step <= MAX_JUMP {
            self.out_of_order = (0, 0);
            return Ok(step - 1);
        } else if sample.seq < self.last_seq {
            Outcome::DroppedBackInTime
        } else {
            Outcome::DroppedSequenceJump
        };
        let (before, count) = self.out_of_order;
        let count = if count > 0 && sample.seq == before.wrapping_add(1) { count + 1 } else { 1 };
        self.out_of_order = (sample.seq, count);
        if count < NEW_ORDER {
            return Err(outcome);
        }
        self.out_of_order = (0, 0);
        // A sequence that went back has lost nothing that can be counted.
        Ok(if outcome == Outcome::DroppedSequenceJump { step - NEW_ORDER } else { 0 })
    }

    fn rejection(&self, sample: &SensorSample, now_ns: u64) -> Option<Outcome> {
        let limits = &self.limits;
        let gap_mm = self.gap_mm(sample);
        let (min_mm, max_mm) = self.gap.range_mm();
        if sample.status != 0 {
            Some(Outcome::HeldSensorFault)
        } else if !sample.pressure_mpa.is_finite() || !gap_mm.is_finite() {
            Some(Outcome::HeldNotFinite)
        } else if !(limits.pressure_min_mpa..=limits.pressure_max_mpa).contains(&sample.pressure_mpa)
            || !(0.0..=limits.gap_max_mm).contains(&gap_mm)
        {
            Some(Outcome::HeldAbsurd)
        } else if !(min_mm..=max_mm).contains(&gap_mm) {
            Some(Outcome::HeldOutsideScene)
        } else if now_ns.saturating_sub(sample.t_sensor_ns) > ms_to_ns(limits.max_age_ms) {
            Some(Outcome::HeldStale)
        } else if sample.t_sensor_ns.saturating_sub(now_ns) > ms_to_ns(limits.max_ahead_ms) {
            Some(Outcome::HeldFuture)
        } else {
            None
        }
    }

    /// The gap that counts: the scene's where it is fixed, the reading's otherwise.
    pub(super) fn gap_mm(&self, sample: &SensorSample) -> f64 {
        match self.gap {
            Gap::Fixed(gap_mm) => gap_mm,
            Gap::Measured(_) | Gap::Range { .. } => sample.gap_mm,
        }
    }
}

#[cfg(test)]
#[path = "../../tests/unit/twin_ingest.rs"]
mod tests;
