//! Memory of the plant, which the model does not know: the value of the first measured input that acts in the actuator plays in or
//! lags behind the one that is read.
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

/// Half-width of the play with amplitude 1, in standard deviations of a reading.
const PLAY_SIGMAS: f64 = 4.0;
/// Time constant of the lag with amplitude 1, s.
const LAG_S: f64 = 0.5;
/// Time constant of the sums of a running filter, s: some cycles of the input.
pub(crate) const CYCLES_S: f64 = 10.0;
/// Smallest amplitude, in standard deviations of its estimate, that is no chance.
const SIGNIFICANT: f64 = 6.0;
/// Smallest amplitude that contradicts measurements.
const MIN_AMPLITUDE: f64 = 0.15;

/// Kind of memory.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Play,
    Lag,
}

/// Standard deviation of an estimate with the effect of memory. Its distance from the prior is a bound: the truth has the prior's
/// standard deviation.
pub(crate) fn widened(patterns: &[Pattern], at: usize, sigma: f64, prior_sigma: f64, from_prior: f64) -> f64 {
    let of_memory = |pattern: &Pattern| pattern.sensitivity[at].powi(2) * pattern.square();
    let with = sigma.hypot(patterns.iter().map(of_memory).sum::<f64>().sqrt());
    with.min(prior_sigma.hypot(from_prior)).max(sigma)
}

/// One kind of memory.
#[derive(Clone, Debug)]
pub(crate) struct Pattern {
    kind: Kind,
    /// Time constant of the sums, s.
    cycles_s: f64,
    /// Acting value.
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
    fn new(kind: Kind, cycles_s: f64) -> Self {
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
        [Self::new(Kind::Play, cycles_s), Self::new(Kind::Lag, cycles_s)]
    }

    /// Moves to the next reading of the input, with the standard deviation of its noise.
    pub(crate) fn advance(&mut self, t_s: f64, value: f64, sigma: f64) {
        let held = self.held.unwrap_or(value);
        let passed_s = if self.held.is_some() { t_s - self.last_t_s } else { 0.0 };
        let held = match self.kind {
            Kind::Play => held.clamp(value - PLAY_SIGMAS * sigma, value + PLAY_SIGMAS * sigma),
            Kind::Lag => held + (value - held) * (1.0 - (-passed_s / LAG_S).exp()),
        };
        self.moves |= self.kind == Kind::Lag || self.held.is_some_and(|before| before != held);
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
