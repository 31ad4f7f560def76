//! The controller: pressure from a wanted force, observable or pressure. Pure; nothing is allocated after its making.
//!
//! With the model's inverse `P(y, gap)` of the quantity `y` and the play `H`; all values are pressures, `p` the gauge's:
//!
//! ```text
//! s' = (P(target) - s) / T_a + rate/(dy/dP)        path: `path.value`, T_a = `approach_s`
//! v  = sum a_k s(t - k/2f)                         shaped path: `shaped_mpa`
//! d  = lag(lag(notch(H(p) - P(y_measured))))       error of the model: `correction_mpa()`, T_d = `correction_s`
//! c  = v + d + o                                   wanted in the cavity: `wanted_cavity_mpa()`; o = `side_mpa`, the side of the play
//! b' = k (q - p) while the pressure is at rest     error of valve and gauge: `bias_mpa`, k = `bias_per_s`, q = `expected_mpa`
//! u  = c + T_l c' + (c(t - delay_s) - p) + b       command, within range and rate; T_l of filling or emptying
//! ```
//!
//! The difference in `u` is there where the gauge is at the cavity. The inverse of the play is not computed: `o` goes to the side of the
//! play from which the motion to come is driven, before the path begins.
//!
//! `d` compares pressure and quantity of one instant, so the line is not in its loop: what is in it is the fraction by which the model's slope is
//! wrong. No integral can wind up: `d` is computed from measurements, `b` from the limited command, and the path never asks for more than the
//! line gives. The gauge shows a command `delay_s` later, so it is compared with the `c` of then.

use crate::inverse::{Inverse, Model, Quantity, inverse};
use crate::monitor::{Fault, Monitor, Signs, Turns};
use crate::plan::{PlanInput, Planner};
use crate::settings::{GaugeAt, LawKind, Limits, LowSupply, Settings, TARGET_FRACTION};
use crate::shape::{Delay, Notch, Path, Plays, Shaper, lag};

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// In N, MPa, or the observable's unit.
    pub value: f64,
    /// Its known change per second: of a ramp or a series; 0 of a step.
    pub rate: f64,
}

impl Target {
    pub fn step(value: f64) -> Self {
        Self { value, rate: 0.0 }
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
    /// Pressure that the valve was last given, MPa; NaN: the last command.
    pub written_mpa: f64,
}

/// Result of one control cycle.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Cycle {
    /// The command, MPa; NaN: the valve is let go because of a fault.
    pub pressure_mpa: f64,
    /// The target, cut at the force limit and at what a low supply gives.
    pub target: f64,
    /// Reference as a pressure in the cavity, MPa.
    pub reference_mpa: f64,
    /// Value of the controlled quantity: measured, or the model's.
    pub followed: f64,
    /// The model's error as a pressure, MPa.
    pub correction_mpa: f64,
    /// The valve's error, MPa.
    pub bias_mpa: f64,
    pub limited: Limited,
    /// The predictive law had no plan in time, or its commands oscillate: the command is that of the inverse.
    pub is_fallback: bool,
    /// The commands have swung to and fro although the target did not: line, delay or play of the settings are wrong. It stays until the control
    /// starts again.
    pub is_oscillating: bool,
    /// Fault that has ended the control.
    pub fault: Option<Fault>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Limited {
    /// The target is beyond the force limit.
    pub by_force: bool,
    /// The target is beyond the model's or the valve's range.
    pub by_range: bool,
    /// The line, the slew or the valve's rate is slower than the reference.
    pub by_rate: bool,
    /// The correction is at its largest: the model does not explain the measurement.
    pub by_correction: bool,
    /// The valve was given another pressure than the command.
    pub by_valve: bool,
    /// The supply gives less than the target needs: what it gives is held.
    pub by_supply: bool,
}

impl Limited {
    /// The target cannot be reached.
    pub fn is_limited(self) -> bool {
        self.by_force || self.by_range || self.by_correction || self.by_valve || self.by_supply
    }
}

/// Where a search ended: the next one begins there, moved along the slope by what the value has changed.
#[derive(Debug, Clone, Copy, Default)]
struct Search {
    value: f64,
    pressure_mpa: f64,
    slope: f64,
}

/// What a search is for: each kind begins where the last of its kind ended.
#[derive(Debug, Clone, Copy)]
enum SearchFor {
    Target,
    Measured,
    ForceLimit,
}

/// Longest time of one control cycle, s: after a longer pause the control starts again.
pub const LONGEST_S: f64 = 0.1;
/// Largest distance of a search's start from the end of the last one, MPa: a slope holds only nearby.
const MAX_MOVE_MPA: f64 = 0.002;
/// Part of the line's slope that the path uses: the rest is for play and correction.
const HEADROOM: f64 = 0.85;
/// The pressure is at rest while command and expected pressure differ by less, MPa.
const REST_MPA: f64 = 0.002;
/// Difference to the wanted pressure behind the play below which the side of the play is kept, MPa.
const SIDE_MPA: f64 = 1e-4;
/// Command per difference of the wanted and the read pressure in the cavity.
const PRESSURE_GAIN: f64 = 1.0;
/// Largest movement of a gauge at rest, relative to its mean over the last half second, MPa.
const STILL_MPA: f64 = 3e-4;
/// Time in which a difference behind the play is taken up at rest, s.
const SIDE_S: f64 = 0.1;
/// The same once the reference has been at its target for [`REST_S`]; a difference below [`SIDE_MPA`] is left then. Before, the side is still
/// being found.
const REST_SIDE_S: f64 = 0.2;
const REST_S: f64 = 1.5;
/// Pressure above what a low supply gives up to which is commanded, MPa.
const SUPPLY_MPA: f64 = 2e-3;
/// Part of half of the play from which its side is reached.
const THROUGH: f64 = 0.1;
/// Fraction of the force limit that no planned state exceeds.
const PLAN_FRACTION: f64 = 0.98;
/// Difference between written and commanded pressure from which the valve's limit binds, MPa.
const WRITTEN_MPA: f64 = 1e-4;

/// The controller's memory.
#[derive(Debug)]
pub struct Controller<M> {
    model: M,
    quantity: Quantity,
    settings: Settings,
    limits: Limits,
    path: Path,
    shaper: Shaper,
    notch: Notch,
    plays: Plays,
    /// Shaped reference, MPa.
    shaped_mpa: f64,
    /// Error of the model as a pressure behind each of its lags, MPa; the second is the correction.
    lags_mpa: [f64; 2],
    /// Distance of the wanted pressure in the cavity from the one behind the play, MPa.
    side_mpa: f64,
    bias_mpa: f64,
    /// What was written and what was wanted in the cavity, as late as the gauge shows it.
    late_written: Delay,
    late_cavity: Delay,
    /// Pressure at the gauge as expected from what was written, and in the cavity as measured, MPa.
    expected_mpa: f64,
    cavity_mpa: f64,
    command_mpa: f64,
    /// The last searches, by [`SearchFor`].
    last: [Search; 3],
    is_started: bool,
    /// Time since the reference arrived, s.
    calm_s: f64,
    /// The quantity was measured since the start.
    is_seen: bool,
    monitor: Monitor,
    turns: Turns,
    planner: Option<Box<Planner>>,
    is_fallback: bool,
    fault: Option<Fault>,
}

impl<M: Model> Controller<M> {
    /// A controller that has not begun.
    pub fn new(model: M, quantity: Quantity, settings: Settings, limits: Limits) -> Self {
        let monitor = Monitor::new(settings.low_supply == LowSupply::Hold);
        Self {
            model,
            quantity,
            shaper: Shaper::new(&settings),
            late_written: Delay::new(settings.delay_s),
            late_cavity: Delay::new(settings.delay_s),
            planner: (settings.law == LawKind::Predictive)
                .then(|| Box::new(Planner::new(&settings, &limits))),
            is_fallback: false,
            settings,
            limits,
            path: Path::default(),
            notch: Notch::default(),
            plays: Plays::at(0.0),
            shaped_mpa: 0.0,
            lags_mpa: [0.0; 2],
            side_mpa: 0.0,
            bias_mpa: 0.0,
            expected_mpa: 0.0,
            cavity_mpa: 0.0,
            command_mpa: 0.0,
            last: [Search::default(); 3],
            is_started: false,
            calm_s: 0.0,
            is_seen: false,
            monitor,
            turns: Turns::default(),
            fault: None,
        }
    }

    /// Releases a fault: the next reading begins the control again.
    pub fn release(&mut self) {
        self.fault = None;
        self.is_started = false;
    }

    /// The model, for inputs that change while it is in use.
    pub fn model_mut(&mut self) -> &mut M {
        &mut self.model
    }

    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Begins, or begins again, where the actuator is: the next command continues from the pressure that is read. To be called
    /// while the valve does not follow (override, interlock, another owner); what was learned of the valve is kept.
    pub fn start(&mut self, reading: Reading) {
        let reading = self.used(reading);
        let [low, high] = self.limits.range_mpa;
        let pressure_mpa = reading.pressure_mpa;
        self.is_started = pressure_mpa.is_finite() && reading.gap_mm.is_finite();
        if !self.is_started {
            return;
        }
        let holds_low_supply = self.settings.low_supply == LowSupply::Hold;
        (self.monitor, self.is_seen) = (Monitor::new(holds_low_supply), false);
        (self.turns, self.calm_s) = (Turns::default(), 0.0);
        self.command_mpa = pressure_mpa.clamp(low, high);
        (self.expected_mpa, self.cavity_mpa) = (pressure_mpa, pressure_mpa);
        self.plays = Plays::at(pressure_mpa);
        let correction_mpa = self.error_mpa(reading, pressure_mpa).unwrap_or(0.0);
        self.lags_mpa = [correction_mpa; 2];
        self.notch.start(correction_mpa);
        self.side_mpa = 0.0;
        self.path.value = pressure_mpa - correction_mpa;
        self.shaped_mpa = self.path.value;
        self.shaper.start(self.path.value);
        self.late_written.start(self.command_mpa);
        self.late_cavity.start(pressure_mpa);
        if let Some(planner) = &mut self.planner {
            planner.start(self.command_mpa, pressure_mpa, correction_mpa);
        }
    }

    /// The command for targets by the time ahead in s, `dt_s` after the last cycle. After more than [`LONGEST_S`] nobody knows what the valve did
    /// meanwhile, and the control starts again. A reading that is not finite changes nothing, and the last command stands.
    pub fn update(&mut self, targets: &dyn Fn(f64) -> Target, reading: Reading, dt_s: f64) -> Cycle {
        let (target, reading) = (targets(self.settings.lead_s()), self.used(reading));
        let inputs = [reading.pressure_mpa, reading.gap_mm, target.value, target.rate, dt_s];
        if self.fault.is_some() || inputs.iter().any(|value| !value.is_finite()) || dt_s < 0.0 {
            return self.cycle(target.value, f64::NAN, Limited::default());
        }
        if !self.is_started || dt_s > LONGEST_S {
            self.start(reading);
        }
        let dt_s = dt_s.min(LONGEST_S);
        let mut limited = Limited::default();
        let followed = self.followed(reading);
        let (wanted, by_force) = self.within(target);
        limited.by_force = by_force;
        let written_mpa =
            if reading.written_mpa.is_finite() { reading.written_mpa } else { self.command_mpa };
        limited.by_valve = (written_mpa - self.command_mpa).abs() > WRITTEN_MPA;
        self.expect(written_mpa, dt_s);
        let behind_mpa = self.behind_play(reading, dt_s);
        let before_mpa = self.wanted_cavity_mpa();
        let error_mpa = self.error_mpa(reading, behind_mpa);
        limited.by_correction = self.correct(error_mpa, dt_s);
        self.watch(reading, written_mpa, behind_mpa, error_mpa, limited.by_correction, dt_s);
        let instead_mpa = self.follow_path(wanted, reading.gap_mm, behind_mpa, dt_s, &mut limited);
        if !limited.by_supply {
            self.learn_bias(reading, dt_s);
        }
        let cavity_mpa = self.wanted_cavity_mpa();
        // At rest it is mostly noise that moves the wanted pressure: the line is not inverted for it.
        let is_driven = dt_s > 0.0 && !self.is_resting();
        let slope = if is_driven { (cavity_mpa - before_mpa) / dt_s } else { 0.0 };
        let time_s = if slope >= 0.0 { self.settings.line.fill_s } else { self.settings.line.empty_s };
        let late_mpa = self.late_cavity.step(before_mpa, dt_s);
        let feedback_mpa = match self.settings.gauge_at {
            GaugeAt::Cavity => PRESSURE_GAIN * (late_mpa - reading.pressure_mpa),
            GaugeAt::Valve => 0.0,
        };
        let inverted_mpa = cavity_mpa + time_s * slope + feedback_mpa + self.bias_mpa;
        let planned_mpa = self.plan(targets, reading.gap_mm, error_mpa, dt_s);
        let wanted_mpa = match limited.by_supply {
            // All that the supply gives: so the gauge shows when it gives more.
            true => self.monitor.most_mpa() + SUPPLY_MPA + self.bias_mpa,
            false => planned_mpa.unwrap_or(inverted_mpa),
        };
        self.command(wanted_mpa, dt_s, &mut limited);
        let play_mpa = 2.0 * self.settings.half_play_mpa();
        let target_mpa = self.last[SearchFor::Target as usize].pressure_mpa;
        self.turns.step(self.command_mpa, target_mpa, play_mpa, dt_s);
        let held = instead_mpa.map(|instead_mpa| {
            let point = self.model.at(instead_mpa, reading.gap_mm);
            self.quantity.of(&point, instead_mpa).0
        });
        self.cycle(held.unwrap_or(wanted.value), followed, limited)
    }

    /// Error of the model as a pressure, behind its lags.
    fn correction_mpa(&self) -> f64 {
        self.lags_mpa[1]
    }

    /// Pressure that is wanted in the cavity.
    fn wanted_cavity_mpa(&self) -> f64 {
        self.shaped_mpa + self.correction_mpa() + self.side_mpa
    }

    /// A reading as the settings take it.
    fn used(&self, reading: Reading) -> Reading {
        let measured = if self.settings.is_measured { reading.measured } else { f64::NAN };
        Reading { measured, ..reading }
    }

    fn cycle(&self, target: f64, followed: f64, limited: Limited) -> Cycle {
        Cycle {
            target,
            pressure_mpa: if self.fault.is_some() { f64::NAN } else { self.command_mpa },
            reference_mpa: self.shaped_mpa,
            followed,
            correction_mpa: self.correction_mpa(),
            bias_mpa: self.bias_mpa,
            limited,
            is_fallback: self.is_fallback,
            is_oscillating: self.turns.is_oscillating(),
            fault: self.fault,
        }
    }

    fn followed(&mut self, reading: Reading) -> f64 {
        if reading.measured.is_finite() {
            return reading.measured;
        }
        let point = self.model.at(reading.pressure_mpa, reading.gap_mm);
        self.quantity.of(&point, reading.pressure_mpa).0
    }

    /// The target, cut at the force limit.
    fn within(&self, target: Target) -> (Target, bool) {
        let most_n = TARGET_FRACTION * self.settings.force_max_n;
        match self.quantity {
            Quantity::Force if target.value > most_n => (Target::step(most_n), true),
            Quantity::Force if target.value < 0.0 => (Target::step(0.0), true),
            _ => (target, false),
        }
    }

    /// Pressures that the written one gives.
    fn expect(&mut self, written_mpa: f64, dt_s: f64) {
        let into_mpa = self.late_written.step(written_mpa, dt_s) - self.bias_mpa;
        self.expected_mpa = match self.settings.gauge_at {
            GaugeAt::Cavity => lag(self.expected_mpa, into_mpa, self.settings.line, dt_s),
            GaugeAt::Valve => into_mpa,
        };
    }

    /// Pressure behind the play, from the gauge.
    fn behind_play(&mut self, reading: Reading, dt_s: f64) -> f64 {
        if self.settings.gauge_at == GaugeAt::Valve {
            self.cavity_mpa = lag(self.cavity_mpa, reading.pressure_mpa, self.settings.line, dt_s);
        } else {
            self.cavity_mpa = reading.pressure_mpa;
        }
        self.plays.follow(&self.settings.play, self.cavity_mpa)
    }

    /// Moves the reference; its slopes are what the line gives from the present pressure. Returns the model's pressure that is held instead of the
    /// target's where the supply is low.
    fn follow_path(
        &mut self,
        target: Target,
        gap_mm: f64,
        behind_mpa: f64,
        dt_s: f64,
        limited: &mut Limited,
    ) -> Option<f64> {
        let value = target.value;
        let ahead = self.search(SearchFor::Target, self.quantity, value, gap_mm);
        let most_mpa = self.limit_mpa(&ahead, value, gap_mm);
        let [low, high] = self.limits.range_mpa.map(|end| end - self.bias_mpa);
        let half_mpa = self.settings.half_play_mpa();
        let shift_mpa = self.correction_mpa();
        // How far the goal may go before the pressure in the cavity would leave the range of the valve.
        let given_mpa = high.min(self.monitor.most_mpa() + SUPPLY_MPA);
        let ends = [low - shift_mpa - half_mpa, given_mpa - shift_mpa - half_mpa];
        let goal_mpa = ahead.pressure_mpa.min(most_mpa);
        let within_mpa = goal_mpa.clamp(ends[0], ends[1]);
        limited.by_force |= goal_mpa < ahead.pressure_mpa;
        limited.by_range = !ahead.is_reached || within_mpa != goal_mpa;
        limited.by_supply = given_mpa < high && goal_mpa > within_mpa;
        let rate = if ahead.slope != 0.0 && within_mpa == goal_mpa { target.rate / ahead.slope } else { 0.0 };
        let line = self.settings.line;
        let [rise, fall] = self.settings.slew_mpa_per_s;
        let at_mpa = self.path.value + shift_mpa + self.side_mpa;
        let down = (HEADROOM * (low - at_mpa) / line.empty_s).min(0.0);
        let up = (HEADROOM * (high - at_mpa) / line.fill_s).max(0.0);
        let missing_mpa = self.shaped_mpa + shift_mpa - behind_mpa;
        let is_there = |from_mpa: f64, to_mpa: f64| (to_mpa - from_mpa).abs() <= SIDE_MPA;
        let is_calm = rate == 0.0
            && is_there(within_mpa, self.path.value)
            && is_there(self.path.value, self.shaped_mpa);
        let was_resting = self.is_resting();
        self.calm_s = if is_calm { self.calm_s + dt_s } else { 0.0 };
        if self.planner.is_some() && self.is_resting() && !was_resting {
            // The plan has led the pressure here, and the first law goes on from it.
            self.side_mpa = (self.cavity_mpa - self.shaped_mpa - shift_mpa).clamp(-half_mpa, half_mpa);
        }
        let is_through = self.take_side(within_mpa - self.path.value, rate, missing_mpa, [down, up], dt_s);
        if is_through {
            let slopes = [down.max(-fall), up.min(rise)];
            limited.by_rate = self.path.step(within_mpa, rate, slopes, self.settings.approach_s, dt_s);
        }
        self.shaped_mpa = self.shaper.step(self.path.value, dt_s);
        limited.by_supply.then_some(within_mpa)
    }

    /// Error of the model as a pressure, from pressure and measurement of one instant; `None` where the measurement says nothing.
    fn error_mpa(&mut self, reading: Reading, behind_mpa: f64) -> Option<f64> {
        if !reading.measured.is_finite() || self.quantity == Quantity::Pressure {
            return None;
        }
        if self.quantity == Quantity::Force && reading.measured < self.limits.contact_n {
            // Without contact the measurement says only that the onset is not reached yet.
            let onset_mpa = self.model.at(behind_mpa, reading.gap_mm).onset_mpa;
            let least_mpa = behind_mpa - onset_mpa;
            return Some(least_mpa.max(self.correction_mpa())).filter(|error_mpa| error_mpa.is_finite());
        }
        let found = self.search(SearchFor::Measured, self.quantity, reading.measured, reading.gap_mm);
        // Slope 0: the tip rests on the plate, its place does not depend on the pressure.
        (found.slope != 0.0).then_some(behind_mpa - found.pressure_mpa)
    }

    /// Lets the correction follow the model's error; true if it is at its limit.
    fn correct(&mut self, error_mpa: Option<f64>, dt_s: f64) -> bool {
        let Some(error_mpa) = error_mpa else { return false };
        let limit = self.settings.correction_max_mpa;
        let error_mpa = error_mpa.clamp(-limit, limit);
        let mut into_mpa = self.notch.step(error_mpa, self.settings.swing_hz, dt_s);
        let share = 1.0 - (-dt_s / self.settings.correction_s).exp();
        for lag_mpa in &mut self.lags_mpa {
            *lag_mpa += (into_mpa - *lag_mpa) * share;
            into_mpa = *lag_mpa;
        }
        error_mpa.abs() >= limit
    }

    fn watch(
        &mut self,
        reading: Reading,
        written_mpa: f64,
        behind_mpa: f64,
        error_mpa: Option<f64>,
        is_at_limit: bool,
        dt_s: f64,
    ) {
        let is_measured = reading.measured.is_finite();
        self.is_seen |= is_measured;
        let has_value = self.quantity == Quantity::Observable || reading.measured >= self.limits.contact_n;
        let signs = Signs {
            written_mpa: written_mpa - self.bias_mpa,
            expected_mpa: self.expected_mpa,
            read_mpa: reading.pressure_mpa,
            bias_mpa: self.bias_mpa,
            driven_mpa: behind_mpa,
            found_mpa: error_mpa.filter(|_| has_value).map(|error_mpa| behind_mpa - error_mpa),
            is_at_limit,
            is_missing: self.is_seen && !is_measured && self.quantity != Quantity::Pressure,
        };
        self.fault = self.monitor.step(signs, dt_s);
    }

    /// Moves the wanted pressure in the cavity to the side of the play from which the motion to come is driven; true if it is there. Motion
    /// begins then, so that it is shaped as a whole.
    fn take_side(
        &mut self,
        ahead_mpa: f64,
        rate: f64,
        missing_mpa: f64,
        slopes: [f64; 2],
        dt_s: f64,
    ) -> bool {
        let half_mpa = self.settings.half_play_mpa();
        if half_mpa == 0.0 {
            return true;
        }
        let ahead_mpa = ahead_mpa + rate * self.settings.approach_s;
        let [down, up] = slopes.map(|slope| slope * dt_s);
        if ahead_mpa.abs() <= SIDE_MPA {
            // At rest: by small steps, which noise does not carry across the play.
            let (side_s, still_mpa) = if self.is_resting() { (REST_SIDE_S, SIDE_MPA) } else { (SIDE_S, 0.0) };
            let missing_mpa = missing_mpa - missing_mpa.clamp(-still_mpa, still_mpa);
            let step_mpa = (missing_mpa * dt_s / side_s).clamp(down, up);
            self.side_mpa = (self.side_mpa + step_mpa).clamp(-half_mpa, half_mpa);
            return true;
        }
        let missing_mpa = half_mpa.copysign(ahead_mpa) - self.side_mpa;
        self.side_mpa += missing_mpa.clamp(down, up);
        (half_mpa.copysign(ahead_mpa) - self.side_mpa).abs() < THROUGH * half_mpa
    }

    /// The valve's error: expected and read pressure at rest.
    fn learn_bias(&mut self, reading: Reading, dt_s: f64) {
        let is_still =
            self.settings.gauge_at == GaugeAt::Valve || self.monitor.gauge_moved_mpa.abs() < STILL_MPA;
        let at_rest = is_still && (self.command_mpa - self.bias_mpa - self.expected_mpa).abs() < REST_MPA;
        // Not in motion: there a wrong line looks like an error of the valve.
        if at_rest {
            let limit = self.settings.bias_max_mpa;
            let error_mpa = self.expected_mpa - reading.pressure_mpa;
            self.bias_mpa =
                (self.bias_mpa + self.settings.bias_per_s * error_mpa * dt_s).clamp(-limit, limit);
        }
    }

    fn command(&mut self, wanted_mpa: f64, dt_s: f64, limited: &mut Limited) {
        let ([low, high], step) = (self.limits.range_mpa, self.limits.rate_mpa_per_s * dt_s);
        let high = high.min(self.monitor.most_mpa() + SUPPLY_MPA + self.bias_mpa).max(low);
        let within = wanted_mpa.clamp(low, high);
        let step = if step.is_nan() { 0.0 } else { step };
        self.command_mpa = within.clamp(self.command_mpa - step, self.command_mpa + step);
        limited.by_rate |= self.command_mpa != wanted_mpa;
    }

    /// Pressure of the force limit; infinite where what is ahead lies clearly below it.
    fn limit_mpa(&mut self, ahead: &Inverse, value: f64, gap_mm: f64) -> f64 {
        let limit_n = self.settings.force_max_n;
        let ahead_n = if self.quantity == Quantity::Force { value } else { ahead.force_n };
        if ahead_n.is_nan() || ahead_n <= TARGET_FRACTION * limit_n {
            return f64::INFINITY;
        }
        self.search(SearchFor::ForceLimit, Quantity::Force, TARGET_FRACTION * limit_n, gap_mm).pressure_mpa
    }

    /// The reference has been at its target for [`REST_S`].
    fn is_resting(&self) -> bool {
        self.calm_s > REST_S
    }

    /// The command of the predictive law; `None` without it, at rest, where its commands oscillate, or where it has none in time. At rest the first
    /// law holds, because a plan would lead through the play for every error of the noise.
    fn plan(
        &mut self,
        targets: &dyn Fn(f64) -> Target,
        gap_mm: f64,
        error_mpa: Option<f64>,
        dt_s: f64,
    ) -> Option<f64> {
        self.is_fallback = self.planner.is_some() && self.turns.is_oscillating();
        if self.is_fallback {
            return None;
        }
        let mut planner = self.planner.take()?;
        let (shift_mpa, mut is_touching) = (self.correction_mpa(), false);
        let given_mpa = self.monitor.most_mpa() + SUPPLY_MPA - shift_mpa - self.settings.half_play_mpa();
        for knot in planner.knots() {
            let target = self.within(targets(knot.ahead_s)).0;
            let found = inverse(&mut self.model, self.quantity, gap_mm, target.value, knot.reference_mpa);
            let most_mpa = self.limit_mpa(&found, target.value, gap_mm);
            knot.reference_mpa = found.pressure_mpa.min(most_mpa).min(given_mpa);
            is_touching |= found.force_n > 0.0;
        }
        let most_n = PLAN_FRACTION * self.settings.force_max_n;
        let most_mpa = if is_touching {
            self.search(SearchFor::ForceLimit, Quantity::Force, most_n, gap_mm).pressure_mpa + shift_mpa
        } else {
            f64::INFINITY
        };
        let now = PlanInput {
            cavity_mpa: self.cavity_mpa,
            plays: self.plays,
            bias_mpa: self.bias_mpa,
            command_mpa: self.command_mpa,
            shift_mpa,
            missing_mpa: error_mpa.map(|error_mpa| shift_mpa - error_mpa),
            most_mpa,
        };
        let is_resting = self.is_resting() && planner.is_flat(SIDE_MPA);
        let command_mpa = if is_resting {
            planner.rest(&self.settings, &now, dt_s);
            None
        } else {
            planner.command(&self.settings, &now, dt_s)
        };
        self.is_fallback = !is_resting && command_mpa.is_none();
        self.planner = Some(planner);
        command_mpa
    }

    fn search(&mut self, purpose: SearchFor, quantity: Quantity, value: f64, gap_mm: f64) -> Inverse {
        let last = self.last[purpose as usize];
        let moved_mpa = (value - last.value) / last.slope;
        let start_mpa = last.pressure_mpa + if moved_mpa.abs() <= MAX_MOVE_MPA { moved_mpa } else { 0.0 };
        let found = inverse(&mut self.model, quantity, gap_mm, value, start_mpa);
        self.last[purpose as usize] = Search { value, pressure_mpa: found.pressure_mpa, slope: found.slope };
        found
    }
}

#[cfg(test)]
#[path = "../tests/unit/law.rs"]
mod tests;
