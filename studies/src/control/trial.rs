//! The controller on the plant, in simulated time: steps, disturbances, noise.

use crate::plant::report::SETTLED;
use crate::plant::{self, Plant};
use control::inverse::{Model, Quantity};
use control::law::{Controller, Reading, Settings};

/// Settings of a trial.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trial {
    /// Followed quantity.
    pub quantity: Quantity,
    /// The quantity is measured: by a load cell, or a camera that sees the tip.
    pub is_measured: bool,
    /// Error of the gap sensor, mm.
    pub gap_error_mm: f64,
    /// Turns a second.
    pub rate_hz: f64,
}

/// Values of one control cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// Since the begin, s.
    pub time_s: f64,
    /// Wanted, N or mm.
    pub target: f64,
    /// Followed value, N or mm.
    pub followed: f64,
    /// The truth, N or mm.
    pub truth: f64,
    /// The true force, N.
    pub force_n: f64,
    /// The command, MPa.
    pub command_mpa: f64,
}

/// Shown gap without a plate, mm: out of the actuator's reach.
const FAR_MM: f64 = 100.0;

/// A controller on a plant.
#[derive(Debug)]
pub struct Loop<M> {
    controller: Controller<M>,
    /// The plant; its gap may be changed between turns.
    pub plant: Plant,
    trial: Trial,
    shown: Option<plant::Reading>,
    time_s: f64,
}

impl<M: Model> Loop<M> {
    /// Both at rest.
    pub fn new(model: M, settings: Settings, plant: Plant, trial: Trial) -> Self {
        let controller = Controller::new(model, trial.quantity, settings);
        Self { controller, plant, trial, shown: None, time_s: 0.0 }
    }

    /// Sets the error of the gap sensor, mm.
    pub fn show_gap_error(&mut self, gap_error_mm: f64) {
        self.trial.gap_error_mm = gap_error_mm;
    }

    /// Turns for `seconds` with one target; the turns are appended.
    pub fn hold(&mut self, target: f64, seconds: f64, moments: &mut Vec<Moment>) {
        let dt_s = 1.0 / self.trial.rate_hz;
        for _ in 0..(seconds * self.trial.rate_hz).round() as usize {
            let now = self.plant.step(dt_s);
            self.time_s += dt_s;
            // The controller uses a reading of the previous cycle.
            let shown = self.shown.replace(now).unwrap_or(now);
            let measured = match (self.trial.is_measured, self.trial.quantity) {
                (false, _) => f64::NAN,
                (true, Quantity::Force) => shown.force_n,
                (true, Quantity::Tip) => shown.true_tip_mm,
            };
            let gap_mm = match self.plant.spec.true_gap_mm + self.trial.gap_error_mm {
                gap_mm if gap_mm.is_finite() => gap_mm,
                _ => FAR_MM,
            };
            let turn = self.controller.update(
                target,
                Reading { pressure_mpa: shown.pressure_mpa, gap_mm, measured },
                dt_s,
            );
            self.plant.command(turn.pressure_mpa);
            let truth = match self.trial.quantity {
                Quantity::Force => now.true_force_n,
                Quantity::Tip => now.true_tip_mm,
            };
            let (target, followed, command_mpa) = (turn.target, turn.followed, turn.pressure_mpa);
            let (time_s, force_n) = (self.time_s, now.true_force_n);
            moments.push(Moment { time_s, target, followed, truth, force_n, command_mpa });
        }
    }
}

/// How a step was followed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepFigures {
    /// Where it began, and its target.
    pub step: [f64; 2],
    /// Farthest beyond the target, share of the step's height; 0: never.
    pub overshoot: f64,
    /// To the last time off by more than 5 % of the target, s; none: still is.
    pub settling_s: Option<f64>,
    /// Mean error over the last quarter, share of the target.
    pub final_error: f64,
    /// Largest force, N.
    pub force_n: f64,
}

/// Figures of a step from its moments; `value` selects the true or the followed value.
pub fn step_figures(from: f64, moments: &[Moment], value: impl Fn(&Moment) -> f64) -> Option<StepFigures> {
    let (first, last) = (moments.first()?, moments.last()?);
    let (target, height) = (last.target, last.target - from);
    let error = |moment: &Moment| value(moment) - target;
    let beyond = moments.iter().map(|moment| error(moment) * height.signum() / height.abs());
    let is_off = |moment: &Moment| error(moment).abs() > SETTLED * target.abs();
    let settling_s = match moments.iter().rposition(is_off) {
        None => Some(0.0),
        Some(at) => moments.get(at + 1).map(|moment| moment.time_s - first.time_s),
    };
    let tail = &moments[moments.len() * 3 / 4..];
    let mean = tail.iter().map(error).sum::<f64>() / tail.len().max(1) as f64;
    Some(StepFigures {
        step: [from, target],
        overshoot: beyond.fold(0.0, f64::max),
        settling_s,
        final_error: mean / target.abs(),
        force_n: moments.iter().map(|moment| moment.force_n).fold(0.0, f64::max),
    })
}
