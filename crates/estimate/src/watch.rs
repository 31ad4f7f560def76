//! Whether model, sensors and estimates still explain the readings, over the last half second.
//!
//! One reading says little: outliers and missing values are normal. Kept are sums over readings, each forgotten by `exp(-t / 0.5 s)`:
//! how often a block was rejected, the noise that a measured input must have had, and the normalised innovations.

use crate::matrix::Vector;
use crate::outcome::{Alarm, Estimate, Status, Update};
use crate::setup::{MAX_INPUTS, MAX_ROWS, Measurement, Setup};

/// Time after which a reading counts 1/e (s).
const MEMORY_S: f64 = 0.5;
/// So long something must not fit before it is said what (s): by then the readings before it count little.
const SETTLE_S: f64 = 0.7;
/// Readings, each counted with its weight, before anything is said.
const MIN_READINGS: f64 = 5.0;
/// Rejected more often than this, a block contradicts the rest.
const MAX_REJECTED_SHARE: f64 = 0.5;
/// Mean noise of a measured input in standard deviations of one reading; the mean of true noise is a small part of one.
const MAX_MEAN_NOISE: f64 = 4.0;
/// An estimate so many prior standard deviations away from its prior.
const MAX_FROM_PRIOR: f64 = 4.0;
/// Standard deviations by which the sum of innovations may exceed its mean.
const MAX_EXCESS: f64 = 6.0;
/// Square of the model's error in its standard deviations that is still normal (quantile 0.9999): it is the same in all readings
/// of the window, so that it does not average out.
const MODEL_SQUARES: f64 = 15.1;

/// Sums over the last readings.
#[derive(Clone, Debug, Default)]
pub(crate) struct Watch {
    last_t_s: Option<f64>,
    /// Since when something does not fit.
    since_s: Option<f64>,
    /// Readings, and those that nothing explained.
    readings: f64,
    unexplained: f64,
    /// By block: values seen, values rejected.
    seen: [f64; MAX_ROWS],
    rejected: [f64; MAX_ROWS],
    /// Readings used; by measured input the noise they needed, in standard deviations.
    used: f64,
    noise: Vector,
    /// Innovations squared, what they may be at most but for chance, and the variance of that.
    innovation: f64,
    allowed: f64,
    variance: f64,
}

impl Watch {
    /// Takes the outcome of a reading. `noise` is that of the measured inputs, by position, where the reading was used.
    pub(crate) fn add(
        &mut self,
        setup: &Setup,
        measurement: &Measurement,
        update: &Update,
        noise: Option<&[f64]>,
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
        if let Some(noise) = noise {
            self.used += 1.0;
            self.innovation += update.nis;
            for ((sum, noise), (_, sigma)) in self.noise.iter_mut().zip(noise).zip(setup.measured_inputs()) {
                *sum += noise / sigma;
            }
        }
    }

    fn forget(&mut self, share: f64) {
        let single = [
            &mut self.readings,
            &mut self.unexplained,
            &mut self.used,
            &mut self.innovation,
            &mut self.allowed,
        ];
        let many = self.seen.iter_mut().chain(&mut self.rejected).chain(&mut self.noise);
        single.into_iter().chain(many).for_each(|sum| *sum *= share);
        self.variance *= share * share;
    }

    /// Says what does not fit, once it lasts. `estimates` come with the standard deviations that they would have without any reading.
    pub(crate) fn judge(
        &mut self,
        setup: &Setup,
        estimates: impl Iterator<Item = (Estimate, f64)>,
    ) -> Option<Alarm> {
        let (found, now_s) = (self.misfit(setup, estimates), self.last_t_s?);
        self.since_s = found.and(self.since_s.or(Some(now_s)));
        found.filter(|_| self.since_s.is_some_and(|since| now_s - since >= SETTLE_S))
    }

    fn misfit(&self, setup: &Setup, estimates: impl Iterator<Item = (Estimate, f64)>) -> Option<Alarm> {
        if self.readings < MIN_READINGS {
            return None;
        }
        let blocks = |which: &dyn Fn(usize) -> bool| {
            (0..MAX_ROWS).filter(|block| which(*block)).fold(0_u32, |bits, block| bits | 1 << block)
        };
        let seen = blocks(&|block| self.seen[block] >= MIN_READINGS);
        let suspects = seen & blocks(&|block| self.rejected[block] > MAX_REJECTED_SHARE * self.seen[block]);
        if self.unexplained > MAX_REJECTED_SHARE * self.readings || (suspects == seen && seen != 0) {
            return Some(Alarm::NotExplained);
        }
        if suspects != 0 {
            return Some(Alarm::Sensor(suspects));
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
        let mut unknowns = 0_u32;
        for (at, ((estimate, unread), unknown)) in estimates.zip(&setup.unknowns).enumerate() {
            let away = (estimate.value - unknown.prior).abs() > MAX_FROM_PRIOR * unread;
            unknowns |= u32::from(estimate.identifiable && away) << at;
        }
        (unknowns != 0).then_some(Alarm::Unknown(unknowns))
    }
}
