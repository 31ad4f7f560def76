//! Judging a reading before anything is computed from it.

use crate::config::{Gap, Limits};
use wire::{Outcome, SensorSample};

/// What came before: run, sequence and time of the last reading.
#[derive(Debug, Clone)]
pub(super) struct Checker {
    limits: Limits,
    gap: Gap,
    boot_id: u64,
    last_seq: u64,
    last_t_sensor_ns: u64,
}

/// The verdict on one reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Verdict {
    /// `None`: good.
    pub refused: Option<Outcome>,
    /// Readings that never arrived before this one.
    pub missed: u64,
    /// The bridge was started anew (also the first reading ever).
    pub restarted: bool,
}

impl Checker {
    pub(super) fn new(limits: Limits, gap: Gap) -> Self {
        Self { limits, gap, boot_id: 0, last_seq: 0, last_t_sensor_ns: 0 }
    }

    /// Continues with another gap; what came before stays known.
    pub(super) fn set_gap(&mut self, gap: Gap) {
        self.gap = gap;
    }

    /// Judges `sample`, which arrived at `now_ns`, and remembers it.
    pub(super) fn judge(&mut self, sample: &SensorSample, now_ns: u64) -> Verdict {
        let restarted = sample.boot_id != self.boot_id;
        if restarted {
            self.boot_id = sample.boot_id;
            self.last_seq = sample.seq.wrapping_sub(1); // what an earlier run sent is not missing from this one
            self.last_t_sensor_ns = 0;
        }
        let verdict = |refused, missed| Verdict { refused, missed, restarted };
        if sample.seq == self.last_seq {
            return verdict(Some(Outcome::DroppedDuplicate), 0);
        }
        if sample.seq < self.last_seq || sample.t_sensor_ns < self.last_t_sensor_ns {
            return verdict(Some(Outcome::DroppedBackInTime), 0);
        }
        let missed = sample.seq.wrapping_sub(self.last_seq).wrapping_sub(1);
        self.last_seq = sample.seq;
        let refused = self.refuse(sample, now_ns);
        // A stamp from the future must not make all later readings look old.
        if refused != Some(Outcome::HeldFuture) {
            self.last_t_sensor_ns = sample.t_sensor_ns;
        }
        verdict(refused, missed)
    }

    fn refuse(&self, sample: &SensorSample, now_ns: u64) -> Option<Outcome> {
        let limits = &self.limits;
        let gap_mm = self.gap_mm(sample);
        let ns = crate::config::ms_to_ns;
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
        } else if now_ns.saturating_sub(sample.t_sensor_ns) > ns(limits.max_age_ms) {
            Some(Outcome::HeldStale)
        } else if sample.t_sensor_ns.saturating_sub(now_ns) > ns(limits.max_ahead_ms) {
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

    fn checker() -> Checker {
        let mut checker = Checker::new(Limits::default(), Gap::Range { min: 30.0, max: 60.0 });
        assert_eq!(checker.judge(&good(10), NOW), Verdict { refused: None, missed: 0, restarted: true });
        checker
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
            assert_eq!(checker().judge(&sample, now).refused, Some(expected), "{name}");
        }
        let mut checker = checker();
        let earlier = SensorSample { t_sensor_ns: NOW - 2_000_000, ..good(11) };
        assert_eq!(checker.judge(&earlier, NOW).refused, Some(Outcome::DroppedBackInTime), "time goes back");
        assert_eq!(checker.judge(&good(12), NOW).refused, None, "the next good reading is accepted");
    }

    #[test]
    fn jumps_are_counted_and_restarts_begin_anew() {
        let mut checker = checker();
        assert_eq!(checker.judge(&good(15), NOW).missed, 4);
        let restarted = SensorSample { boot_id: 8, seq: 1, t_sensor_ns: NOW - 5_000_000, ..good(1) };
        assert_eq!(checker.judge(&restarted, NOW), Verdict { refused: None, missed: 0, restarted: true });
    }

    #[test]
    fn a_stamp_from_the_future_does_not_age_the_readings_after_it() {
        let mut checker = checker();
        let future = SensorSample { t_sensor_ns: NOW + 3_600_000_000_000, ..good(11) };
        assert_eq!(checker.judge(&future, NOW).refused, Some(Outcome::HeldFuture));
        assert_eq!(checker.judge(&good(12), NOW).refused, None);
    }

    #[test]
    fn a_fixed_gap_needs_no_measured_one() {
        let mut checker = Checker::new(Limits::default(), Gap::Fixed(40.0));
        let blind = SensorSample { gap_mm: f64::NAN, ..good(1) };
        assert_eq!(checker.judge(&blind, NOW).refused, None);
        assert_eq!(checker.gap_mm(&blind), 40.0);
    }
}
