//! The controller: pressure from a force or a tip position that is wanted. Pure; nothing is allocated after its making.
//!
//! With the model's inverse `P(y, gap)` of the quantity `y` that is followed:
//!
//! ```text
//! r'' + 2 r'/T + r/T^2 = target/T^2                reference, critically damped            T = reference_s
//! d'  = (p - P(y_measured, gap) - d) / T_d          model's error as a pressure: integral   T_d = correction_s
//! w   = P(r, gap) + d,  at most P(limit, gap) + d   pressure that is wanted in the chambers
//! q'  = (u - b - q) / T_l                           pressure that is expected there         T_l = lag_s
//! b'  = k (q - p) while the pressure is at rest     valve's and gauge's error: integral     k = bias_per_s
//! u   = w + T_l r' / (dy/dP) + b                    command, within range and rate
//! ```
//!
//! `d` compares pressure and quantity of the same instant, so the valve's lag is not in its loop: what is in it is the fraction by
//! which the model's slope is wrong, and a loop whose gain is below 1 is stable whatever the delay. Neither integral can wind
//! up: `d` is computed from the measurements, `b` follows the limited command.

use crate::inverse::{Inverse, Model, Quantity, inverse};

/// Share of the force limit that a target is cut at: the rest is for overshoot.
pub const TARGET_SHARE: f64 = 0.95;

/// Times, limits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Time constant of the reference, s.
    pub reference_s: f64,
    /// Time constant of the model's correction, s.
    pub correction_s: f64,
    /// Largest correction of the model, MPa.
    pub correction_max_mpa: f64,
    /// Lag of valve and line, s.
    pub lag_s: f64,
    /// Share of the valve's error that is taken up in a second, 1/s.
    pub bias_per_s: f64,
    /// Largest correction of the valve, MPa.
    pub bias_max_mpa: f64,
    /// The pressure is at rest while command and expected pressure differ by less, MPa.
    pub rest_mpa: f64,
    /// Lowest and highest pressure that is commanded, MPa.
    pub range_mpa: [f64; 2],
    /// Greatest change of the command, MPa/s.
    pub rate_mpa_per_s: f64,
    /// Force that must not be passed, N; a target is cut at [`TARGET_SHARE`] of it.
    pub force_max_n: f64,
    /// A measured force below this is no contact yet, N: three standard deviations of the load cell's noise.
    pub contact_n: f64,
}

impl Default for Settings {
    /// For the reference actuator on a valve with a lag of 80 ms.
    fn default() -> Self {
        Self {
            reference_s: 0.1,
            correction_s: 0.03,
            correction_max_mpa: 0.04,
            lag_s: 0.08,
            bias_per_s: 3.0,
            bias_max_mpa: 0.01,
            rest_mpa: 0.002,
            range_mpa: [0.0, 0.09],
            rate_mpa_per_s: 0.4,
            force_max_n: 0.6,
            contact_n: 0.008,
        }
    }
}

impl Settings {
    /// All errors in the settings.
    pub fn problems(&self) -> Vec<String> {
        let mut problems = Vec::new();
        for (name, value) in [
            ("reference_s", self.reference_s),
            ("correction_s", self.correction_s),
            ("lag_s", self.lag_s),
            ("rate_mpa_per_s", self.rate_mpa_per_s),
            ("force_max_n", self.force_max_n),
        ] {
            if value.is_nan() || value <= 0.0 {
                problems.push(format!("{name}: expected more than 0, found {value}"));
            }
        }
        for (name, value) in [
            ("correction_max_mpa", self.correction_max_mpa),
            ("bias_per_s", self.bias_per_s),
            ("bias_max_mpa", self.bias_max_mpa),
            ("rest_mpa", self.rest_mpa),
            ("contact_n", self.contact_n),
        ] {
            if !(value.is_finite() && value >= 0.0) {
                problems.push(format!("{name}: expected 0 or more, found {value}"));
            }
        }
        let [low, high] = self.range_mpa;
        if !(low.is_finite() && high.is_finite() && low < high) {
            problems.push(format!("range_mpa: expected lowest < highest, found {low} .. {high}"));
        }
        problems
    }
}

/// Measurements of one control cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Gauge, MPa.
    pub pressure_mpa: f64,
    /// Gap, mm: measured or estimated.
    pub gap_mm: f64,
    /// The measured quantity; NaN: not measured, the model's value at the gauge's pressure is used.
    pub measured: f64,
}

/// Result of one control cycle.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Turn {
    /// The command, MPa.
    pub pressure_mpa: f64,
    /// The target, cut at the force limit, N or mm.
    pub target: f64,
    /// The reference, N or mm.
    pub reference: f64,
    /// Value of the controlled quantity: measured, or the model's.
    pub followed: f64,
    /// The model's error as a pressure, MPa.
    pub correction_mpa: f64,
    /// The valve's error, MPa.
    pub bias_mpa: f64,
    /// The target is beyond the force limit or the model's range: less is asked for.
    pub is_limited: bool,
}

/// Where a search ended: the next one begins there, moved along the slope by what the value has changed, and mostly needs one
/// evaluation.
#[derive(Debug, Clone, Copy, Default)]
struct Search {
    value: f64,
    pressure_mpa: f64,
    slope: f64,
}

/// Largest distance of a search's start from the end of the last one, MPa: a slope holds only nearby.
const MAX_MOVE_MPA: f64 = 0.002;

/// The controller's memory.
#[derive(Debug)]
pub struct Controller<M> {
    model: M,
    quantity: Quantity,
    settings: Settings,
    /// Reference, and the stage before it.
    reference: [f64; 2],
    correction_mpa: f64,
    bias_mpa: f64,
    expected_mpa: f64,
    command_mpa: f64,
    /// The last searches: for reference, measured value and force limit.
    last: [Search; 3],
    is_started: bool,
}

impl<M: Model> Controller<M> {
    /// A controller that has not begun.
    pub fn new(model: M, quantity: Quantity, settings: Settings) -> Self {
        Self {
            model,
            quantity,
            settings,
            reference: [0.0; 2],
            correction_mpa: 0.0,
            bias_mpa: 0.0,
            expected_mpa: 0.0,
            command_mpa: 0.0,
            last: [Search::default(); 3],
            is_started: false,
        }
    }

    /// The model, for inputs that change while it is in use.
    pub fn model_mut(&mut self) -> &mut M {
        &mut self.model
    }

    /// Begins, or begins again, where the actuator is: the next command continues from the pressure that is read. To be called
    /// while the valve does not follow (override, interlock, another owner); what was learned of model and valve is kept.
    pub fn start(&mut self, reading: Reading) {
        let now = self.followed(reading);
        self.reference = [now; 2];
        let [low, high] = self.settings.range_mpa;
        self.command_mpa = reading.pressure_mpa.clamp(low, high);
        self.expected_mpa = reading.pressure_mpa;
        self.is_started = reading.pressure_mpa.is_finite() && now.is_finite();
    }

    /// The command for a target in N or mm, `dt_s` after the last turn. A reading that is not finite changes nothing, and the
    /// last command stands.
    pub fn update(&mut self, target: f64, reading: Reading, dt_s: f64) -> Turn {
        let is_usable =
            [reading.pressure_mpa, reading.gap_mm, target, dt_s].iter().all(|value| value.is_finite());
        if !is_usable || dt_s < 0.0 {
            return self.turn(target, f64::NAN, false);
        }
        if !self.is_started {
            self.start(reading);
        }
        let followed = self.followed(reading);
        let (target, cut) = self.within(target);
        let speed = self.move_reference(target, dt_s);
        self.correct(reading, dt_s);
        let ahead = self.search(0, self.reference[1], reading.gap_mm);
        let most_mpa = self.limit_mpa(&ahead, reading.gap_mm);
        let wanted_mpa = (ahead.pressure_mpa.min(most_mpa)) + self.correction_mpa;
        let is_out = self.hold_reference(wanted_mpa, reading.gap_mm);
        self.learn_bias(reading, dt_s);
        let lead_mpa = if ahead.slope != 0.0 { self.settings.lag_s * speed / ahead.slope } else { 0.0 };
        self.command(wanted_mpa + lead_mpa + self.bias_mpa, dt_s);
        self.turn(target, followed, cut || is_out || !ahead.is_reached || ahead.pressure_mpa > most_mpa)
    }

    fn turn(&self, target: f64, followed: f64, is_limited: bool) -> Turn {
        Turn {
            target,
            pressure_mpa: self.command_mpa,
            reference: self.reference[1],
            followed,
            correction_mpa: self.correction_mpa,
            bias_mpa: self.bias_mpa,
            is_limited,
        }
    }

    fn followed(&mut self, reading: Reading) -> f64 {
        if reading.measured.is_finite() {
            return reading.measured;
        }
        let point = self.model.at(reading.pressure_mpa, reading.gap_mm);
        self.quantity.of(&point).0
    }

    /// The target, cut at the force limit.
    fn within(&self, target: f64) -> (f64, bool) {
        let most_n = TARGET_SHARE * self.settings.force_max_n;
        match self.quantity {
            Quantity::Force if target > most_n => (most_n, true),
            Quantity::Force if target < 0.0 => (0.0, true),
            _ => (target, false),
        }
    }

    /// Two lags, exact for a target that stays over the step; returns the reference's speed.
    fn move_reference(&mut self, target: f64, dt_s: f64) -> f64 {
        let share = 1.0 - (-dt_s / self.settings.reference_s).exp();
        self.reference[0] += (target - self.reference[0]) * share;
        self.reference[1] += (self.reference[0] - self.reference[1]) * share;
        (self.reference[0] - self.reference[1]) / self.settings.reference_s
    }

    /// A reference beyond the range of the command stays at what the end of the range gives, so that it leaves it at once.
    fn hold_reference(&mut self, wanted_mpa: f64, gap_mm: f64) -> bool {
        let [low, high] = self.settings.range_mpa;
        let command_mpa = wanted_mpa + self.bias_mpa;
        let is_within = (low..=high).contains(&command_mpa);
        if !is_within {
            let end_mpa = command_mpa.clamp(low, high) - self.bias_mpa;
            let point = self.model.at(end_mpa - self.correction_mpa, gap_mm);
            self.reference = [self.quantity.of(&point).0; 2];
        }
        !is_within
    }

    /// Error of the model as a pressure, from pressure and measurement of the same instant.
    fn correct(&mut self, reading: Reading, dt_s: f64) {
        if !reading.measured.is_finite() {
            return;
        }
        let share = 1.0 - (-dt_s / self.settings.correction_s).exp();
        let limit = self.settings.correction_max_mpa;
        let is_free = self.quantity == Quantity::Force && reading.measured < self.settings.contact_n;
        let error_mpa = if is_free {
            // Without contact the measurement says only that the onset is not reached yet.
            let onset_mpa = self.model.at(reading.pressure_mpa, reading.gap_mm).onset_mpa;
            (reading.pressure_mpa - onset_mpa).max(self.correction_mpa)
        } else {
            let found = self.search(1, reading.measured, reading.gap_mm);
            if found.slope == 0.0 {
                return; // the tip rests on the plate: its place says nothing of the pressure
            }
            reading.pressure_mpa - found.pressure_mpa
        };
        self.correction_mpa += (error_mpa.clamp(-limit, limit) - self.correction_mpa) * share;
    }

    /// The valve's error: expected and read pressure at rest.
    fn learn_bias(&mut self, reading: Reading, dt_s: f64) {
        let at_rest = (self.command_mpa - self.bias_mpa - self.expected_mpa).abs() < self.settings.rest_mpa;
        if at_rest {
            let limit = self.settings.bias_max_mpa;
            let error_mpa = self.expected_mpa - reading.pressure_mpa;
            self.bias_mpa =
                (self.bias_mpa + self.settings.bias_per_s * error_mpa * dt_s).clamp(-limit, limit);
        }
    }

    fn command(&mut self, wanted_mpa: f64, dt_s: f64) {
        // The command before was in force since the last turn.
        let share = 1.0 - (-dt_s / self.settings.lag_s).exp();
        self.expected_mpa += (self.command_mpa - self.bias_mpa - self.expected_mpa) * share;
        let ([low, high], step) = (self.settings.range_mpa, self.settings.rate_mpa_per_s * dt_s);
        let within = wanted_mpa.clamp(low, high);
        self.command_mpa = within.clamp(self.command_mpa - step, self.command_mpa + step);
    }

    /// Pressure of the force limit; infinite where what is ahead lies clearly below it.
    fn limit_mpa(&mut self, ahead: &Inverse, gap_mm: f64) -> f64 {
        let limit_n = self.settings.force_max_n;
        let ahead_n = match self.quantity {
            Quantity::Force => self.reference[1],
            Quantity::Tip => ahead.force_n,
        };
        if ahead_n <= TARGET_SHARE * limit_n {
            return f64::INFINITY;
        }
        self.search_of(2, Quantity::Force, limit_n, gap_mm).pressure_mpa
    }

    fn search(&mut self, slot: usize, value: f64, gap_mm: f64) -> Inverse {
        self.search_of(slot, self.quantity, value, gap_mm)
    }

    fn search_of(&mut self, slot: usize, quantity: Quantity, value: f64, gap_mm: f64) -> Inverse {
        let last = self.last[slot];
        let moved_mpa = (value - last.value) / last.slope;
        let start_mpa = last.pressure_mpa + if moved_mpa.abs() <= MAX_MOVE_MPA { moved_mpa } else { 0.0 };
        let found = inverse(&mut self.model, quantity, gap_mm, value, start_mpa);
        self.last[slot] = Search { value, pressure_mpa: found.pressure_mpa, slope: found.slope };
        found
    }
}

#[cfg(test)]
#[path = "../tests/unit/law.rs"]
mod tests;
