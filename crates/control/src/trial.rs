//! A controller on a plant in simulated time, and the figures that are read off it.

use crate::inverse::{Model, Quantity};
use crate::law::{Controller, Cycle, Reading, Target};
use crate::monitor::Fault;
use crate::plant::{Plant, PlantReading, RestingBody};
use serde::Serialize;

/// A law that gives a command for each reading.
pub trait Law {
    /// The command for targets by the time ahead in s, `dt_s` after the last cycle.
    fn update(&mut self, targets: &dyn Fn(f64) -> Target, reading: Reading, dt_s: f64) -> Cycle;
}

impl<M: Model> Law for Controller<M> {
    fn update(&mut self, targets: &dyn Fn(f64) -> Target, reading: Reading, dt_s: f64) -> Cycle {
        Self::update(self, targets, reading, dt_s)
    }
}

/// Circumstances of a trial.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trial {
    pub quantity: Quantity,
    /// The quantity is measured: by a load cell, or a camera.
    pub is_measured: bool,
    /// Shown minus true gap, mm.
    pub gap_error_mm: f64,
    /// Control cycles per second.
    pub rate_hz: f64,
}

/// Values of one control cycle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Moment {
    /// Since the begin, s.
    pub time_s: f64,
    /// Wanted, in the unit of the quantity.
    pub target: f64,
    /// Measured, or the model's.
    pub followed: f64,
    pub truth: f64,
    /// The true force, N.
    pub force_n: f64,
    pub command_mpa: f64,
    /// The true pressure in the cavity, MPa.
    pub pressure_mpa: f64,
    /// The target cannot be reached.
    pub is_limited: bool,
    /// Fault that has ended the control.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fault: Option<Fault>,
}

/// Shown gap without a plate, mm: out of the actuator's reach.
const FAR_MM: f64 = 100.0;

/// A law on a plant.
#[derive(Debug)]
pub struct Loop<L, B> {
    pub law: L,
    /// The plant; its specification may be changed between cycles.
    pub plant: Plant<B>,
    /// Circumstances; the error of the gap may be changed.
    pub trial: Trial,
    shown: Option<PlantReading>,
    time_s: f64,
}

impl<L: Law, B: RestingBody> Loop<L, B> {
    pub fn new(law: L, plant: Plant<B>, trial: Trial) -> Self {
        Self { law, plant, trial, shown: None, time_s: 0.0 }
    }

    /// Cycles for `seconds` with one target; they are appended.
    pub fn hold(&mut self, target: f64, seconds: f64, moments: &mut Vec<Moment>) {
        self.follow(|_| Target::step(target), seconds, moments);
    }

    /// Cycles for `seconds` with the target of each time since this begins.
    pub fn follow(&mut self, target: impl Fn(f64) -> Target, seconds: f64, moments: &mut Vec<Moment>) {
        let dt_s = 1.0 / self.trial.rate_hz;
        let Trial { quantity, is_measured, .. } = self.trial;
        for at in 0..(seconds * self.trial.rate_hz).round() as usize {
            let now = self.plant.step(dt_s);
            self.time_s += dt_s;
            // The controller uses a reading of the previous cycle.
            let shown = self.shown.replace(now).unwrap_or(now);
            let measured = if is_measured { shown.of(quantity)[0] } else { f64::NAN };
            let gap_mm = match self.plant.spec.true_gap_mm + self.trial.gap_error_mm {
                gap_mm if gap_mm.is_finite() => gap_mm,
                _ => FAR_MM,
            };
            let reading =
                Reading { pressure_mpa: shown.pressure_mpa, gap_mm, measured, written_mpa: f64::NAN };
            let at_s = at as f64 * dt_s;
            let cycle = self.law.update(&|ahead_s| target(at_s + ahead_s), reading, dt_s);
            // Let go, the valve takes its safe value.
            self.plant.command(if cycle.fault.is_some() { 0.0 } else { cycle.pressure_mpa });
            moments.push(Moment {
                time_s: self.time_s,
                target: target(at_s).value.min(if cycle.limited.by_force {
                    cycle.target
                } else {
                    f64::INFINITY
                }),
                followed: cycle.followed,
                truth: now.of(quantity)[1],
                force_n: now.true_force_n,
                command_mpa: cycle.pressure_mpa,
                pressure_mpa: now.true_pressure_mpa,
                fault: cycle.fault,
                is_limited: cycle.limited.is_limited(),
            });
        }
    }
}

/// Relative error within which a value is settled.
pub const SETTLED: f64 = 0.05;

/// How a step was followed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct StepFigures {
    /// Beginning and target.
    pub step: [f64; 2],
    /// From 10 to 90 % of the height, s; `None`: not reached.
    pub rise_s: Option<f64>,
    /// Farthest beyond the target, fraction of the step's height; 0: never.
    pub overshoot: f64,
    /// To the last time farther from the target than 5 % of the step's height, s; `None`: still is.
    pub settling_s: Option<f64>,
    /// Mean error over the last quarter, in the unit of the quantity.
    pub final_error: f64,
    /// Half of the range of the values later than 1 s after the beginning of the step, fraction of its height.
    pub residual: f64,
    /// Largest force, N.
    pub force_n: f64,
    /// Highest command, MPa.
    pub command_mpa: f64,
}

/// Figures of a step from its cycles; `value` selects the true or the followed value.
pub fn step_figures(from: f64, moments: &[Moment], value: impl Fn(&Moment) -> f64) -> Option<StepFigures> {
    let (first, last) = (moments.first()?, moments.last()?);
    let (target, height) = (last.target, last.target - from);
    let error = |moment: &Moment| value(moment) - target;
    let part = |moment: &Moment| (value(moment) - from) / height;
    let is_off = |moment: &Moment| error(moment).abs() > SETTLED * height.abs();
    let settling_s = match moments.iter().rposition(is_off) {
        None => Some(0.0),
        Some(at) => moments.get(at + 1).map(|moment| moment.time_s - first.time_s),
    };
    let reached = |share: f64| Some(moments.iter().find(|moment| part(moment) >= share)?.time_s);
    let tail = &moments[moments.len() * 3 / 4..];
    let later = moments.iter().filter(|moment| moment.time_s > first.time_s + 1.0).map(part);
    let [least, most] =
        later.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], part| [low.min(part), high.max(part)]);
    Some(StepFigures {
        step: [from, target],
        rise_s: reached(0.9).zip(reached(0.1)).map(|(end, begin)| end - begin),
        overshoot: moments.iter().map(|moment| part(moment) - 1.0).fold(0.0, f64::max),
        settling_s,
        final_error: tail.iter().map(error).sum::<f64>() / tail.len().max(1) as f64,
        residual: 0.5 * (most - least).max(0.0),
        force_n: moments.iter().map(|moment| moment.force_n).fold(0.0, f64::max),
        command_mpa: moments.iter().map(|moment| moment.command_mpa).fold(0.0, f64::max),
    })
}

/// How a sine was followed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SineFigures {
    /// Amplitude of the truth relative to the target's.
    pub amplitude: f64,
    /// Lag of the truth, degrees.
    pub lag_deg: f64,
    /// Root mean square of the difference relative to the target's amplitude.
    pub error: f64,
}

/// First harmonic of the truth relative to that of the target; `moments` are whole periods of `hz`.
pub fn sine_figures(hz: f64, moments: &[Moment]) -> SineFigures {
    let harmonic = |value: fn(&Moment) -> f64| {
        let mean = moments.iter().map(value).sum::<f64>() / moments.len() as f64;
        let sum = |wave: fn(f64) -> f64| -> f64 {
            let w = std::f64::consts::TAU * hz;
            moments.iter().map(|moment| (value(moment) - mean) * wave(w * moment.time_s)).sum()
        };
        let (sine, cosine) = (sum(f64::sin), sum(f64::cos));
        (sine.hypot(cosine), cosine.atan2(sine))
    };
    let (target, truth) = (harmonic(|moment| moment.target), harmonic(|moment| moment.truth));
    let amplitude = 2.0 * target.0 / moments.len() as f64;
    let square = moments.iter().map(|moment| (moment.truth - moment.target).powi(2)).sum::<f64>();
    let lag = (target.1 - truth.1).to_degrees();
    SineFigures {
        amplitude: truth.0 / target.0,
        lag_deg: (lag + 180.0).rem_euclid(360.0) - 180.0,
        error: (square / moments.len() as f64).sqrt() / amplitude,
    }
}
