//! The experiment of `softtwin tune`: steps up and down at three pressures, then a slow ramp up and down. What is disturbed on the way is repeated.

use crate::held::Held;
use crate::inverse::{Model, Quantity, inverse};
use crate::settings::TARGET_FRACTION;
use crate::twin_model::TwinModel;
use rom::statistics::ends;

/// Setpoints over time, as straight lines between points of time in s and MPa.
#[derive(Debug, Clone)]
pub struct Experiment {
    points: Vec<[f64; 2]>,
    /// Begin and end of each step's hold, s.
    pub holds_s: Vec<[f64; 2]>,
    /// Begins of its parts, s: each step with its hold, and each way of the ramp.
    parts_s: Vec<f64>,
    hold_s: f64,
}

/// The pressures, as fractions of the range, and the height of the steps.
const LEVELS: [f64; 3] = [0.3, 0.55, 0.8];
const STEP: f64 = 0.2;
/// Least and greatest hold, s, and its multiple of the longest time of the line.
const HOLD_S: [f64; 2] = [4.0, 20.0];
const HOLD_TIMES: f64 = 5.0;
/// Times of a hold for the ramp in each direction.
const RAMP_HOLDS: f64 = 4.0;

/// Part of the force limit that the experiment reaches in the model.
const FORCE_PART: f64 = 0.8;
/// Fastest change of the setpoint where the valve has no rate, as part of the range in a second.
const RATE_PART: f64 = 20.0;

impl Experiment {
    /// Within range, model and force limit of what is held.
    pub fn of(held: &Held, model: &mut TwinModel, gap_mm: f64) -> Self {
        let ([low, high], known) = (held.limits.range_mpa, model.range_mpa());
        let force_n = FORCE_PART * TARGET_FRACTION * held.settings.force_max_n;
        let at_force_mpa = inverse(model, Quantity::Force, gap_mm, force_n, low).pressure_mpa;
        let range_mpa = [low.max(known[0]), high.min(known[1]).min(at_force_mpa)];
        let line = held.settings.line;
        let rate = held.limits.rate_mpa_per_s.min(RATE_PART * (range_mpa[1] - range_mpa[0]));
        Self::new(range_mpa, line.fill_s.max(line.empty_s), rate)
    }

    /// Within a range of pressures, for a line whose longest time is about `time_s`; steps no faster than `rate_mpa_per_s`.
    pub fn new([low, high]: [f64; 2], time_s: f64, rate_mpa_per_s: f64) -> Self {
        let hold_s = (HOLD_TIMES * time_s).clamp(HOLD_S[0], HOLD_S[1]);
        let mut made = Self { points: vec![[0.0, low]], holds_s: Vec::new(), parts_s: Vec::new(), hold_s };
        let pressure_at = |share: f64| low + share * (high - low);
        for level in LEVELS {
            for share in [level, level + STEP, level] {
                made.go(pressure_at(share.min(1.0)), rate_mpa_per_s);
                let begin = made.end_s();
                made.hold(hold_s);
                made.holds_s.push([begin, made.end_s()]);
            }
        }
        made.go(low, rate_mpa_per_s);
        made.hold(hold_s);
        let slow = (high - low) / (RAMP_HOLDS * hold_s);
        made.go(high, slow);
        made.go(low, slow);
        made.hold(hold_s);
        made
    }

    fn last(&self) -> [f64; 2] {
        self.points.last().copied().unwrap_or_default()
    }

    pub fn end_s(&self) -> f64 {
        self.last()[0]
    }

    fn go(&mut self, to_mpa: f64, rate_mpa_per_s: f64) {
        let [time_s, from_mpa] = self.last();
        self.parts_s.push(time_s);
        self.points.push([time_s + (to_mpa - from_mpa).abs() / rate_mpa_per_s, to_mpa]);
    }

    fn hold(&mut self, seconds: f64) {
        let [time_s, at_mpa] = self.last();
        self.points.push([time_s + seconds, at_mpa]);
    }

    /// Lowest and highest pressure, MPa.
    pub fn range_mpa(&self) -> [f64; 2] {
        ends(self.points.iter().map(|point| point[1]))
    }

    /// Setpoint at a time, MPa.
    pub fn at(&self, time_s: f64) -> f64 {
        let after = self.points.partition_point(|point| point[0] <= time_s);
        let [from, to] =
            [after.saturating_sub(1), after.min(self.points.len() - 1)].map(|at| self.points[at]);
        let part = if to[0] > from[0] { ((time_s - from[0]) / (to[0] - from[0])).max(0.0) } else { 0.0 };
        from[1] + part * (to[1] - from[1])
    }

    /// For people: what will happen.
    pub fn text(&self) -> String {
        let [_, most] = self.range_mpa();
        format!(
            "steps up and down at {} pressures, then a ramp up and down: at most {most:.4} MPa, {:.0} s",
            LEVELS.len(),
            self.end_s()
        )
    }
}

/// Disturbances that are made up for.
pub const MOST_REPEATS: u32 = 5;

/// An experiment on its way. A part that a late cycle has disturbed is driven again, and before it, without being recorded, the part before it:
/// its step is wider than a play, so line and play are again where they were.
#[derive(Debug, Clone)]
pub struct Progress {
    /// Time of the experiment at the begin of the drive, s, as a correction of the elapsed time.
    shift_s: f64,
    /// Time of the experiment from which readings count, s.
    from_s: f64,
    pub repeats: u32,
}

impl Progress {
    pub fn begin() -> Self {
        Self { shift_s: 0.0, from_s: f64::NEG_INFINITY, repeats: 0 }
    }

    /// Time of the experiment after so many seconds of driving.
    pub fn time_s(&self, elapsed_s: f64) -> f64 {
        elapsed_s + self.shift_s
    }

    /// Whether a reading of that time counts: it belongs to no part that is driven again only to come to the next one.
    pub fn counts(&self, time_s: f64) -> bool {
        time_s >= self.from_s
    }

    /// Goes back before the part under way. Returns its begin, from which on what was read before does not count; `None` after too many repeats.
    pub fn repeat(&mut self, experiment: &Experiment, elapsed_s: f64) -> Option<f64> {
        if self.repeats == MOST_REPEATS {
            return None;
        }
        self.repeats += 1;
        let reached_s = self.time_s(elapsed_s).max(self.from_s);
        let parts_s = &experiment.parts_s;
        let part = parts_s.partition_point(|begin_s| *begin_s <= reached_s).saturating_sub(1);
        let before_s = parts_s[part.saturating_sub(1)] - experiment.hold_s;
        self.from_s = parts_s[part];
        self.shift_s = before_s - elapsed_s;
        Some(self.from_s)
    }
}

#[cfg(test)]
#[path = "../tests/unit/experiment.rs"]
mod tests;
