//! Validation of a reading before anything is computed from it.

use crate::config::{Gap, Limits, ms_to_ns};
use wire::{Outcome, SensorSample};

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
mod tests {
    use super::*;

    const NOW: u64 = 10_000_000_000;

    fn good(seq: u64) -> SensorSample {
        SensorSample {
            boot_id: 7,
            seq,
            t_sensor_ns: NOW - 1_000_000 + seq,
            pressure_mpa: 0.03,
            gap_mm: 40.0,
            ..SensorSample::default()
        }
    }

    fn validator() -> Validator {
        let mut validator = Validator::new(Limits::default(), Gap::Range { min: 30.0, max: 60.0 });
        assert_eq!(
            validator.validate(&good(10), NOW),
            SampleCheck { rejection: None, missed: 0, restarted: true }
        );
        validator
    }

    #[test]
    fn every_bad_reading_has_its_outcome() {
        let cases: [(&str, SensorSample, Outcome); 13] = [
            ("NaN pressure", SensorSample { pressure_mpa: f64::NAN, ..good(11) }, Outcome::HeldNotFinite),
            (
                "infinite pressure",
                SensorSample { pressure_mpa: f64::INFINITY, ..good(11) },
                Outcome::HeldNotFinite,
            ),
            ("NaN gap", SensorSample { gap_mm: f64::NAN, ..good(11) }, Outcome::HeldNotFinite),
            ("negative pressure", SensorSample { pressure_mpa: -0.02, ..good(11) }, Outcome::HeldAbsurd),
            ("absurd pressure", SensorSample { pressure_mpa: 5.0, ..good(11) }, Outcome::HeldAbsurd),
            ("negative gap", SensorSample { gap_mm: -1.0, ..good(11) }, Outcome::HeldAbsurd),
            ("absurd gap", SensorSample { gap_mm: 1e6, ..good(11) }, Outcome::HeldAbsurd),
            ("gap beyond the scene", SensorSample { gap_mm: 61.0, ..good(11) }, Outcome::HeldOutsideScene),
            ("sensor fault", SensorSample { status: 3, ..good(11) }, Outcome::HeldSensorFault),
            ("late", SensorSample { t_sensor_ns: NOW - 990_000, ..good(11) }, Outcome::HeldStale),
            (
                "from the future",
                SensorSample { t_sensor_ns: NOW + 200_000_000, ..good(11) },
                Outcome::HeldFuture,
            ),
            ("repeated", good(10), Outcome::DroppedDuplicate),
            ("earlier sequence", good(9), Outcome::DroppedBackInTime),
        ];
        for (name, sample, expected) in cases {
            // "late": the same stamp, looked at two seconds later.
            let now = if expected == Outcome::HeldStale { NOW + 2_000_000_000 } else { NOW };
            assert_eq!(validator().validate(&sample, now).rejection, Some(expected), "{name}");
        }
        let mut validator = validator();
        let earlier = SensorSample { t_sensor_ns: NOW - 2_000_000, ..good(11) };
        assert_eq!(
            validator.validate(&earlier, NOW).rejection,
            Some(Outcome::DroppedBackInTime),
            "time goes back"
        );
        assert_eq!(validator.validate(&good(12), NOW).rejection, None, "the next good reading is accepted");
    }

    #[test]
    fn jumps_are_counted_and_restarts_begin_anew() {
        let mut validator = validator();
        assert_eq!(validator.validate(&good(15), NOW).missed, 4);
        let restarted = SensorSample { boot_id: 8, seq: 1, t_sensor_ns: NOW - 5_000_000, ..good(1) };
        assert_eq!(
            validator.validate(&restarted, NOW),
            SampleCheck { rejection: None, missed: 0, restarted: true }
        );
    }

    /// One wrong number, however large, costs that reading and no other; a pause of any length costs two.
    #[test]
    fn a_jump_of_the_sequence_is_a_fault_of_that_reading_alone() {
        for wrong in [u64::MAX, u64::MAX - 1, 1 << 40, 11 + MAX_JUMP] {
            let mut validator = validator();
            let jump = SensorSample { seq: wrong, ..good(11) };
            let check = validator.validate(&jump, NOW);
            assert_eq!((check.rejection, check.missed), (Some(Outcome::DroppedSequenceJump), 0), "{wrong}");
            assert_eq!(validator.validate(&good(12), NOW).missed, 1, "{wrong}");
            assert_eq!(validator.validate(&good(13), NOW).rejection, None);
        }
        let mut validator = validator();
        let after = |seq: u64| SensorSample { seq: 1_000_000 + seq, ..good(20 + seq) };
        let expected = [Some(Outcome::DroppedSequenceJump), Some(Outcome::DroppedSequenceJump), None, None];
        for (seq, expected) in (0..).zip(expected) {
            let check = validator.validate(&after(seq), NOW);
            assert_eq!(check.rejection, expected, "{seq}");
            assert_eq!(check.missed, if seq == 2 { 999_989 } else { 0 }, "10 was the last before 1000000");
        }
    }

    #[test]
    fn a_run_that_begins_with_a_wrong_number_recovers() {
        let mut validator = validator();
        let first = SensorSample { boot_id: 8, seq: 1 << 40, ..good(11) };
        assert_eq!(validator.validate(&first, NOW).rejection, None);
        let rejections: Vec<bool> = (1..6)
            .map(|seq| SensorSample { boot_id: 8, seq, ..good(20 + seq) })
            .map(|sample| validator.validate(&sample, NOW).rejection.is_some())
            .collect();
        assert!(!rejections[2..].contains(&true), "{rejections:?}");
    }

    #[test]
    fn a_stamp_from_the_future_does_not_age_the_readings_after_it() {
        let mut validator = validator();
        let future = SensorSample { t_sensor_ns: NOW + 3_600_000_000_000, ..good(11) };
        assert_eq!(validator.validate(&future, NOW).rejection, Some(Outcome::HeldFuture));
        assert_eq!(validator.validate(&good(12), NOW).rejection, None);
    }

    #[test]
    fn a_fixed_gap_needs_no_measured_one() {
        let mut validator = Validator::new(Limits::default(), Gap::Fixed(40.0));
        let blind = SensorSample { gap_mm: f64::NAN, ..good(1) };
        assert_eq!(validator.validate(&blind, NOW).rejection, None);
        assert_eq!(validator.gap_mm(&blind), 40.0);
    }
}
