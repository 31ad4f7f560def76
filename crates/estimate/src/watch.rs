//! What the model does not explain: persistent contradictions, and memory of the plant.
//!
//! Outliers and missing values of single readings are normal. The watch keeps sums over readings with weights `exp(-t / 0.5 s)`: the
//! rejections per block, the estimated noise of the measured inputs, and the normalised innovations. The noise of rising and falling
//! inputs is kept over some cycles: memory of the plant, which the model does not know, shows there.
//!
//! Memory: what acts in the actuator is behind the first measured input by a play or a lag.
//!
//! For each kind, `d` is the difference of both at an amplitude of 1: a play of half-width [`PLAY_SIGMAS`], or a lag of [`LAG_S`].
//! The errors of unknowns and noise per unit of amplitude follow from the filter's own gain, and the amplitude `a` from the
//! regression of the estimated noise `e` on them, with the prior `N(0, 1)`:
//!
//! ```text
//! (S, e_d) <- (S, 0) + A^-1 J^T W (J_e d - J_x S)
//! I = sum e_d^2 / sigma^2,    a = (sum e e_d / sigma^2) / (1 + I),    variance of an unknown += S^2 (a^2 + 1 / (1 + I))
//! ```
//!
//! In a motion, whose load takes up the noise, `I` and `a` are those of the residuals: `I = sum r_d^T W r_d - r_d^T W J A^-1 J^T W r_d`, with
//! `r_d = J_e d - J_x S` and the score `sum r^T W r_d`.
//!
//! Until the input has reversed, memory is not distinguishable from a bias: `I` stays small, and the bias keeps a wide interval.

use crate::matrix::{MAX_STATES, Vector};
use crate::setup::{Alarm, Estimate, MAX_INPUTS, MAX_ROWS, MeasuredRow, Measurement, Setup, Status, Update};
use crate::structure::Window;
use crate::trial;

/// Time constant of the weights (s).
const MEMORY_S: f64 = 0.5;
/// Duration of a contradiction before it raises an alarm (s); earlier readings then have little weight.
const SETTLE_S: f64 = 0.7;
/// Smallest weighted number of readings for an alarm.
const MIN_READINGS: f64 = 5.0;
/// Fraction of rejections beyond which a block contradicts the rest.
const MAX_REJECTED_FRACTION: f64 = 0.5;
/// Largest mean noise of a measured input, in standard deviations of one reading.
const MAX_MEAN_NOISE: f64 = 4.0;
/// Largest distance of an estimate from its prior, in prior standard deviations.
const MAX_FROM_PRIOR: f64 = 4.0;
/// The same if a sensor is to be named.
const MAX_FROM_PRIOR_OF_WITNESSES: f64 = 2.5;
/// Largest excess of the sum of innovations over its mean, in standard deviations.
const MAX_EXCESS: f64 = 6.0;
/// Largest normal square of the model's error, in its variance (quantile 0.9999). The error is the same in all readings of the
/// window, so it does not average out.
const MODEL_SQUARES: f64 = 15.1;

/// Change of a measured input that reverses its direction, in standard deviations of one reading.
const REVERSAL: f64 = 8.0;
/// Largest difference of the mean noise between rising and falling, in standard deviations of one reading.
const MAX_DIRECTION_NOISE: f64 = 0.75;

/// Noise of a measured input by its direction. Memory of the plant (play, lag, hysteresis) differs between rising and falling.
#[derive(Clone, Copy, Debug, Default)]
struct Direction {
    /// Largest value since it rises, smallest since it falls.
    extreme: Option<f64>,
    /// Present direction: 0 falling, 1 rising; `None` until the first change.
    now: Option<usize>,
    /// Sum of the noise and number of readings, falling and rising.
    sums: [[f64; 2]; 2],
}

impl Direction {
    /// Adds the noise of a reading, then takes its value for the direction of the next one: chosen by the same noise, a mean would
    /// be biased.
    fn add(&mut self, value: f64, noise: f64, weight: f64) {
        self.sums.as_flattened_mut().iter_mut().for_each(|sum| *sum *= weight);
        if let Some(now) = self.now {
            self.sums[now][0] += noise;
            self.sums[now][1] += 1.0;
        }
        let extreme = *self.extreme.get_or_insert(value);
        let further = if self.now == Some(0) { extreme - value } else { value - extreme };
        if further.abs() > REVERSAL && (self.now.is_none() || further < 0.0) {
            self.now = Some(usize::from(value > extreme));
            self.extreme = Some(value);
        } else if self.now.is_some() && further > 0.0 {
            self.extreme = Some(value);
        }
    }

    /// True if the mean noise differs between the directions by more than chance.
    fn differs(&self) -> bool {
        let [[down, downs], [up, ups]] = self.sums;
        let few = downs.min(ups) < MIN_READINGS;
        let chance = MAX_EXCESS * (1.0 / downs + 1.0 / ups).sqrt();
        !few && (up / ups - down / downs).abs() > chance.max(MAX_DIRECTION_NOISE)
    }
}

/// Sums over the last readings.
#[derive(Clone, Debug, Default)]
pub(crate) struct AlarmWatch {
    last_t_s: Option<f64>,
    /// Begin of the present contradiction, and of the present kind of it.
    since_s: Option<f64>,
    kind_since_s: f64,
    found: Option<Alarm>,
    /// The alarm that stands, and when there was evidence for one last.
    standing: Option<Alarm>,
    evident_s: f64,
    /// Begin of the present rejections, and whether a drifted quantity was tried as their cause.
    rejecting_since_s: Option<f64>,
    has_tried: bool,
    /// Residuals of the readings that were used.
    window: Window,
    readings: f64,
    /// Readings that were not used.
    unexplained: f64,
    /// Values per block.
    seen: [f64; MAX_ROWS],
    /// Rejected values per block.
    rejected: [f64; MAX_ROWS],
    used: f64,
    /// Noise per measured input in the readings used, in standard deviations.
    noise: Vector,
    /// Squared normalised innovations.
    innovation: f64,
    /// Largest expected value of `innovation`.
    allowed: f64,
    /// Variance of `innovation`.
    variance: f64,
    /// Noise by direction, per measured input.
    directions: [Direction; MAX_INPUTS],
}

impl AlarmWatch {
    /// Adds the outcome of a reading. `noise` is that of the measured inputs, in order, `residuals` those at the estimates without it;
    /// `None` if the reading was not used.
    pub(crate) fn add(
        &mut self,
        setup: &Setup,
        measurement: &Measurement,
        update: &Update,
        solved: Option<(&[f64], &[f64; MAX_ROWS])>,
    ) {
        let passed_s = measurement.t_s - self.last_t_s.unwrap_or(measurement.t_s);
        self.last_t_s = Some(measurement.t_s);
        self.forget((-passed_s / MEMORY_S).exp());
        self.readings += 1.0;
        let explained = update.status == Status::Used;
        self.unexplained += f64::from(u8::from(!explained));
        let mut counted = None;
        for (row, value) in setup.rows.iter().zip(&measurement.rows) {
            let rejected = update.rejected & (1 << row.block) != 0;
            if value.is_finite() && counted != Some(row.block) {
                counted = Some(row.block);
                self.seen[row.block] += 1.0;
                self.rejected[row.block] += f64::from(u8::from(rejected));
            }
            if value.is_finite() && explained && !rejected {
                let of_model = row.model_sigma * row.model_sigma / row.variance(1.0);
                self.allowed += 1.0 + of_model * (MODEL_SQUARES - 1.0);
                self.variance += 2.0;
            }
        }
        if let Some((noise, residuals)) = solved {
            self.window.add(measurement.t_s, residuals);
            self.used += 1.0;
            self.innovation += update.nis;
            for ((sum, noise), (_, sigma)) in self.noise.iter_mut().zip(noise).zip(setup.measured_inputs()) {
                *sum += noise / sigma;
            }
            let cycles = (-passed_s / CYCLES_S).exp();
            for ((direction, noise), (input, sigma)) in
                self.directions.iter_mut().zip(noise).zip(setup.measured_inputs())
            {
                if let Some(value) = measurement.inputs.get(input) {
                    direction.add(value / sigma, noise / sigma, cycles);
                }
            }
        }
    }

    fn forget(&mut self, weight: f64) {
        let single = [
            &mut self.readings,
            &mut self.unexplained,
            &mut self.used,
            &mut self.innovation,
            &mut self.allowed,
        ];
        let many = self.seen.iter_mut().chain(&mut self.rejected).chain(&mut self.noise);
        single.into_iter().chain(many).for_each(|sum| *sum *= weight);
        self.variance *= weight * weight;
    }

    /// The alarm that stands: a contradiction that has lasted for `SETTLE_S`, until there has been no evidence of any for the setup's
    /// `alarm_hold_s`. `estimates` come with their standard deviations without any reading; `may_be_memory`: memory of the plant may be
    /// what contradicts; `is_trying`: whether a quantity has drifted is being tried, and no alarm is raised meanwhile.
    pub(crate) fn judge(
        &mut self,
        setup: &Setup,
        estimates: impl Iterator<Item = (Estimate, f64)>,
        may_be_memory: bool,
        is_trying: bool,
    ) -> Option<Alarm> {
        let (found, now_s) = (self.misfit(setup, estimates, may_be_memory), self.last_t_s?);
        self.since_s = found.and(self.since_s.or(Some(now_s)));
        if found != self.found {
            (self.found, self.kind_since_s) = (found, now_s);
        }
        if self.since_s.is_some_and(|since| now_s - since >= SETTLE_S && !is_trying) {
            // Another kind replaces the one that stands when it has lasted as long.
            if self.standing.is_none() || now_s - self.kind_since_s >= SETTLE_S {
                self.standing = found;
            }
            self.evident_s = now_s;
        } else if now_s - self.evident_s >= setup.alarm_hold_s {
            self.standing = None;
        }
        self.standing
    }

    /// Whether values have been rejected for so long that a drifted quantity is tried as the cause; once for each contradiction.
    pub(crate) fn asks_for_trial(&mut self, now_s: f64) -> bool {
        if !self.rejects() {
            (self.rejecting_since_s, self.has_tried) = (None, false);
            return false;
        }
        let since = *self.rejecting_since_s.get_or_insert(now_s);
        let asks = !self.has_tried && now_s - since >= trial::BEGIN_S;
        self.has_tried |= asks;
        asks
    }

    /// These unknowns, one bit each, were elsewhere, and explain what was rejected.
    pub(crate) fn has_drifted(&mut self, unknowns: u32, now_s: f64) {
        if unknowns != 0 {
            (self.standing, self.evident_s) = (Some(Alarm::Unknown(unknowns)), now_s);
        }
        (self.since_s, self.found) = (None, None);
        (self.rejected, self.unexplained) = ([0.0; MAX_ROWS], 0.0);
        self.begin_window();
    }

    /// Whether most values of a block, or most readings, are rejected.
    fn rejects(&self) -> bool {
        let mut blocks = self.rejected.iter().zip(&self.seen).filter(|(_, seen)| **seen >= MIN_READINGS);
        self.unexplained > MAX_REJECTED_FRACTION * self.readings
            || blocks.any(|(rejected, seen)| *rejected > MAX_REJECTED_FRACTION * seen)
    }

    /// Forgets what is left over of earlier readings.
    pub(crate) fn begin_window(&mut self) {
        self.window = Window::default();
    }

    /// Factor by which what is left in the readings widens the standard deviations of the estimates.
    pub(crate) fn widening(&self, rows: &[MeasuredRow]) -> f64 {
        self.window.widening(rows)
    }

    fn misfit(
        &self,
        setup: &Setup,
        estimates: impl Iterator<Item = (Estimate, f64)>,
        may_be_memory: bool,
    ) -> Option<Alarm> {
        if self.readings < MIN_READINGS {
            return None;
        }
        let blocks = |which: &dyn Fn(usize) -> bool| {
            (0..MAX_ROWS).filter(|block| which(*block)).fold(0_u32, |bits, block| bits | 1 << block)
        };
        let seen = blocks(&|block| self.seen[block] >= MIN_READINGS);
        let suspects =
            seen & blocks(&|block| self.rejected[block] > MAX_REJECTED_FRACTION * self.seen[block]);
        if self.unexplained > MAX_REJECTED_FRACTION * self.readings || (suspects == seen && seen != 0) {
            return Some(Alarm::NotExplained);
        }
        let differs = self.directions.iter().any(Direction::differs);
        if suspects != 0 {
            // The accepted values tell which sensor is wrong only if they agree with model and priors themselves.
            let mut away = estimates.zip(&setup.unknowns).enumerate();
            let is_told = away.all(|(index, ((estimate, unread), unknown))| {
                let off = (estimate.value - unknown.prior).abs();
                off <= MAX_FROM_PRIOR_OF_WITNESSES * unread || setup.is_moving(index)
            });
            return Some(if is_told && !differs && !may_be_memory {
                Alarm::Sensor(suspects)
            } else {
                Alarm::NotExplained
            });
        }
        if self.used < MIN_READINGS {
            return None;
        }
        let (mut inputs, mut noise) = (0_u32, self.noise.iter());
        for (input, _) in setup.measured_inputs().filter(|(input, _)| *input < MAX_INPUTS) {
            let mean = noise.next().map_or(0.0, |sum| sum / self.used);
            inputs |= u32::from(mean.abs() > MAX_MEAN_NOISE) << input;
        }
        if inputs != 0 {
            return Some(Alarm::Input(inputs));
        }
        if self.innovation > self.allowed + MAX_EXCESS * self.variance.sqrt() {
            return Some(Alarm::NotExplained);
        }
        if self.window.is_unexplained(&setup.rows) {
            return Some(Alarm::NotExplained);
        }
        let mut unknowns = 0_u32;
        for (index, ((estimate, unread), unknown)) in estimates.zip(&setup.unknowns).enumerate() {
            let away = (estimate.value - unknown.prior).abs() > MAX_FROM_PRIOR * unread;
            unknowns |= u32::from(estimate.identifiable && away && !setup.is_moving(index)) << index;
        }
        (unknowns != 0).then_some(Alarm::Unknown(unknowns))
    }
}

// ---- memory of the plant ----

/// Half-width of the play with amplitude 1, in standard deviations of a reading.
const PLAY_SIGMAS: f64 = 4.0;
/// Time constant of the lag with amplitude 1, s.
const LAG_S: f64 = 0.5;
/// Time constant of the sums over some cycles of the input, s: of a running filter, and of the noise per direction.
pub(crate) const CYCLES_S: f64 = 10.0;
/// Smallest amplitude, in standard deviations of its estimate, that is no chance.
const SIGNIFICANT: f64 = 6.0;
/// Smallest amplitude that contradicts measurements.
const MIN_AMPLITUDE: f64 = 0.15;

#[derive(Clone, Copy, Debug, PartialEq)]
enum MemoryKind {
    Play,
    Lag,
}

/// Standard deviation of an estimate with the effect of memory. Its distance from the prior is a bound: the truth has the prior's
/// standard deviation.
pub(crate) fn widened(
    patterns: &[Pattern],
    unknown: usize,
    sigma: f64,
    prior_sigma: f64,
    from_prior: f64,
) -> f64 {
    let of_memory = |pattern: &Pattern| pattern.sensitivity[unknown].powi(2) * pattern.square();
    let with = sigma.hypot(patterns.iter().map(of_memory).sum::<f64>().sqrt());
    with.min(prior_sigma.hypot(from_prior)).max(sigma)
}

/// One kind of memory.
#[derive(Clone, Debug)]
pub(crate) struct Pattern {
    kind: MemoryKind,
    /// Time constant of the sums, s.
    cycles_s: f64,
    /// Value that acts in the actuator behind the play or the lag.
    held: Option<f64>,
    last_t_s: f64,
    /// The play was passed once; readings at rest have none.
    moves: bool,
    /// Read minus acting value.
    difference: f64,
    /// Errors of the unknowns per unit of amplitude.
    sensitivity: Vector,
    /// Time since the last reading in the sums, s.
    passed_s: f64,
    /// `sum e_d^2 / sigma^2` and `sum e e_d / sigma^2`.
    information: f64,
    score: f64,
}

impl Pattern {
    fn new(kind: MemoryKind, cycles_s: f64) -> Self {
        Self {
            kind,
            cycles_s,
            held: None,
            last_t_s: f64::NAN,
            moves: false,
            difference: 0.0,
            sensitivity: [0.0; MAX_STATES],
            passed_s: 0.0,
            information: 0.0,
            score: 0.0,
        }
    }

    /// All kinds, with the time constant of their sums (s).
    pub(crate) fn all(cycles_s: f64) -> [Self; 2] {
        [Self::new(MemoryKind::Play, cycles_s), Self::new(MemoryKind::Lag, cycles_s)]
    }

    /// Moves to the next reading of the input, with the standard deviation of its noise.
    pub(crate) fn advance(&mut self, t_s: f64, value: f64, sigma: f64) {
        let held = self.held.unwrap_or(value);
        let passed_s = if self.held.is_some() { t_s - self.last_t_s } else { 0.0 };
        let held = match self.kind {
            MemoryKind::Play => held.clamp(value - PLAY_SIGMAS * sigma, value + PLAY_SIGMAS * sigma),
            MemoryKind::Lag => held + (value - held) * (1.0 - (-passed_s / LAG_S).exp()),
        };
        self.moves |= self.kind == MemoryKind::Lag || self.held.is_some_and(|before| before != held);
        self.difference = if self.moves { value - held } else { 0.0 };
        (self.held, self.last_t_s) = (Some(held), t_s);
        self.passed_s += passed_s;
    }

    /// Read minus acting value of the present reading.
    pub(crate) fn difference(&self) -> f64 {
        self.difference
    }

    /// Errors of the unknowns per unit of amplitude.
    pub(crate) fn sensitivity(&self) -> &Vector {
        &self.sensitivity
    }

    /// Replaces the error of an unknown, which a motion has carried.
    pub(crate) fn set(&mut self, unknown: usize, error: f64) {
        self.sensitivity[unknown] = error;
    }

    /// Adds the change of these errors by a reading.
    pub(crate) fn move_by(&mut self, step: &[f64]) {
        self.sensitivity.iter_mut().zip(step).for_each(|(s, step)| *s += step);
    }

    /// Adds the score and the information of a reading about the amplitude.
    pub(crate) fn compare(&mut self, score: f64, information: f64) {
        let weight = (-std::mem::take(&mut self.passed_s) / self.cycles_s).exp();
        self.information = weight * self.information + information;
        self.score = weight * self.score + score;
    }

    fn amplitude(&self) -> f64 {
        self.score / (1.0 + self.information)
    }

    /// Mean square of the amplitude.
    pub(crate) fn square(&self) -> f64 {
        self.amplitude().powi(2) + 1.0 / (1.0 + self.information)
    }

    /// True if the readings look like this memory, or like another cause that changes as slowly.
    pub(crate) fn may_be(&self) -> bool {
        self.score.abs() > SIGNIFICANT * self.information.sqrt() && self.amplitude().abs() > MIN_AMPLITUDE
    }
}
