//! Validation of a reading before anything is computed from it.

use crate::config::{Gap, Limits, ms_to_ns};
use crate::load::LoadedActuator;
use crate::measured::{MeasuredInputs, MeasuredValue};
use rom::inputs::{Inputs, Needs};
use wire::{Outcome, SensorSample};

/// Most sequence numbers between two readings; more is a fault of the later one.
const MAX_JUMP: u64 = 65_536;
/// Most readings that a pause can have lost: 24 days at 2 kHz. A larger jump is another beginning of the sender's count, of which
/// nothing is missing.
const MAX_LOST: u64 = 1 << 32;
/// Number of consecutive readings that begin a new order if they agree with each other and not with the earlier ones: one wrong
/// number must not make all later readings look old.
const NEW_ORDER: u64 = 3;

/// Values that scene and model require of a reading.
#[derive(Debug, Clone)]
pub(super) struct Needed {
    gap: Gap,
    /// Inputs that the model's answers depend on. An absent other one is 0 or no obstacle.
    depends: Needs,
    measured: MeasuredInputs,
}

impl Needed {
    pub(super) fn of(loaded: &LoadedActuator) -> Self {
        let measured = MeasuredInputs::new(&loaded.spec, loaded.session.evaluator().inputs());
        let mut depends = loaded.session.evaluator().needs();
        depends.pressure |= loaded.session.follows_pressure();
        // A reading's gap is ignored if the gap is estimated.
        let estimated = loaded.spec.estimate.get("gap_mm");
        let gap = estimated.map_or(loaded.spec.gap_mm, |unknown| Gap::Fixed(unknown.prior));
        Self { gap, depends, measured }
    }
}

/// Validates readings in their order: keeps run, sequence and time of the last one.
#[derive(Debug, Clone)]
pub(super) struct Validator {
    limits: Limits,
    needed: Needed,
    boot_id: u64,
    last_seq: u64,
    last_t_sensor_ns: u64,
    /// Numbers that do not continue those of the last reading, but each other.
    out_of_order: SequenceRun,
    /// Numbers dropped for their stamps since the last reading.
    dropped: SequenceRun,
}

/// Some sequence numbers since the last reading: the last of them, and how many.
#[derive(Debug, Clone, Copy, Default)]
struct SequenceRun {
    last_seq: u64,
    count: u64,
}

/// The result of validating one reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct SampleCheck {
    /// Why it is not used; `None`: it is.
    pub rejection: Option<Outcome>,
    /// Readings that never arrived before this one.
    pub missed: u64,
    /// The bridge was restarted (also the first reading).
    pub restarted: bool,
}

impl Validator {
    pub(super) fn new(limits: Limits, needed: Needed) -> Self {
        Self {
            limits,
            needed,
            boot_id: 0,
            last_seq: 0,
            last_t_sensor_ns: 0,
            out_of_order: SequenceRun::default(),
            dropped: SequenceRun::default(),
        }
    }

    /// Continues with other needs; what came before stays known.
    pub(super) fn set_needed(&mut self, needed: Needed) {
        self.needed = needed;
    }

    /// Validates `sample`, which arrived at `now_ns`, and remembers it.
    pub(super) fn validate(&mut self, sample: &SensorSample, now_ns: u64) -> SampleCheck {
        let mut restarted = sample.boot_id != self.boot_id;
        if restarted {
            self.boot_id = sample.boot_id;
            self.last_seq = sample.seq.wrapping_sub(1); // what an earlier run sent is not missing from this one
            self.last_t_sensor_ns = 0;
            (self.out_of_order, self.dropped) = (SequenceRun::default(), SequenceRun::default());
        }
        let missed = match self.order(sample) {
            // What was dropped since the last one has arrived and is not missing.
            Ok(missed) if missed > MAX_LOST => {
                (restarted, self.last_t_sensor_ns) = (true, 0);
                0
            }
            Ok(missed) => missed.saturating_sub(self.dropped.count),
            Err(outcome) => {
                self.note_dropped(sample, outcome);
                return SampleCheck { rejection: Some(outcome), missed: 0, restarted };
            }
        };
        self.dropped = SequenceRun::default();
        self.last_seq = sample.seq;
        let rejection = self.rejection(sample, now_ns);
        // A stamp from the future must not make all later readings look old, whatever else is wrong with its reading.
        if !self.is_ahead(sample, now_ns) {
            self.last_t_sensor_ns = sample.t_sensor_ns;
        }
        SampleCheck { rejection, missed, restarted }
    }

    /// Counts numbers ahead of the last one whose readings were dropped for their stamps; they may be sent again.
    fn note_dropped(&mut self, sample: &SensorSample, outcome: Outcome) {
        let step = sample.seq.wrapping_sub(self.last_seq);
        let is_new = self.dropped.count == 0 || step > self.dropped.last_seq.wrapping_sub(self.last_seq);
        if outcome == Outcome::DroppedBackInTime && (1..=MAX_JUMP).contains(&step) && is_new {
            self.dropped = SequenceRun { last_seq: sample.seq, count: self.dropped.count + 1 };
        }
    }

    /// Readings that are missing before this one; an error when it does not follow the last one.
    fn order(&mut self, sample: &SensorSample) -> Result<u64, Outcome> {
        let step = sample.seq.wrapping_sub(self.last_seq);
        let outcome = if step == 0 {
            return Err(Outcome::DroppedDuplicate);
        } else if sample.t_sensor_ns < self.last_t_sensor_ns {
            return Err(Outcome::DroppedBackInTime);
        } else if step <= MAX_JUMP {
            self.out_of_order = SequenceRun::default();
            return Ok(step - 1);
        } else if sample.seq < self.last_seq {
            Outcome::DroppedBackInTime
        } else {
            Outcome::DroppedSequenceJump
        };
        let before = self.out_of_order;
        let follows = before.count > 0 && sample.seq == before.last_seq.wrapping_add(1);
        let count = if follows { before.count + 1 } else { 1 };
        self.out_of_order = SequenceRun { last_seq: sample.seq, count };
        if count < NEW_ORDER {
            return Err(outcome);
        }
        self.out_of_order = SequenceRun::default();
        // A sequence that went back has lost nothing that can be counted.
        Ok(if outcome == Outcome::DroppedSequenceJump { step - NEW_ORDER } else { 0 })
    }

    fn rejection(&self, sample: &SensorSample, now_ns: u64) -> Option<Outcome> {
        let limits = &self.limits;
        let (pressure_mpa, gap_mm) = (self.pressure_mpa(sample), self.gap_mm(sample));
        let (min_mm, max_mm) = self.needed.gap.range_mm();
        let has_no_obstacle = self.has_no_obstacle(sample);
        if sample.status != 0 {
            Some(Outcome::HeldSensorFault)
        } else if !pressure_mpa.is_finite()
            || !(gap_mm.is_finite() || has_no_obstacle)
            || self.measured(sample).any(|measured| !measured.value.is_finite())
        {
            Some(Outcome::HeldNotFinite)
        } else if !(limits.pressure_min_mpa..=limits.pressure_max_mpa).contains(&pressure_mpa)
            || !((0.0..=limits.gap_max_mm).contains(&gap_mm) || has_no_obstacle)
        {
            Some(Outcome::HeldAbsurd)
        } else if !((min_mm..=max_mm).contains(&gap_mm) || has_no_obstacle) {
            Some(Outcome::HeldOutsideScene)
        } else if self.measured(sample).any(|measured| !measured.can_occur) {
            Some(Outcome::HeldInputOutsideScene)
        } else if now_ns.saturating_sub(sample.t_sensor_ns) > ms_to_ns(limits.max_age_ms) {
            Some(Outcome::HeldStale)
        } else if self.is_ahead(sample, now_ns) {
            Some(Outcome::HeldFuture)
        } else {
            None
        }
    }

    /// True if the stamp is later than this machine's clock allows.
    fn is_ahead(&self, sample: &SensorSample, now_ns: u64) -> bool {
        sample.t_sensor_ns.saturating_sub(now_ns) > ms_to_ns(self.limits.max_ahead_ms)
    }

    /// The pressure that counts: the reading's, or 0 where there is none and no answer depends on it.
    fn pressure_mpa(&self, sample: &SensorSample) -> f64 {
        if sample.pressure_mpa.is_nan() && !self.needed.depends.pressure { 0.0 } else { sample.pressure_mpa }
    }

    /// The gap that counts: the scene's where it is fixed, the reading's otherwise; infinite where there is none and no answer
    /// depends on it.
    pub(super) fn gap_mm(&self, sample: &SensorSample) -> f64 {
        match self.needed.gap {
            Gap::Fixed(gap_mm) => gap_mm,
            _ if self.has_no_obstacle(sample) => f64::INFINITY,
            Gap::Measured(_) | Gap::Range { .. } => sample.gap_mm,
        }
    }

    /// True if the gap has no source and no result depends on it.
    fn has_no_obstacle(&self, sample: &SensorSample) -> bool {
        !self.needed.depends.gap && !matches!(self.needed.gap, Gap::Fixed(_)) && sample.gap_mm.is_nan()
    }

    fn measured<'a>(&'a self, sample: &'a SensorSample) -> impl Iterator<Item = MeasuredValue> + 'a {
        self.needed.measured.of(sample.input_count, &sample.input_names, &sample.inputs)
    }

    /// The model's inputs in a reading; NaN if absent.
    pub(super) fn inputs(&self, sample: &SensorSample) -> Inputs {
        let operating = Inputs::new(self.pressure_mpa(sample), self.gap_mm(sample));
        self.measured(sample).fold(operating, |inputs, measured| inputs.with(measured.input, measured.value))
    }
}

#[cfg(test)]
#[path = "../../tests/unit/twin_ingest.rs"]
mod tests;
