//! Consistency of model, sensors and estimates with the readings of the last half second.
//!
//! Outliers and missing values of single readings are normal. The watch keeps sums over readings with weights `exp(-t / 0.5 s)`: the
//! rejections per block, the estimated noise of the measured inputs, and the normalised innovations. The noise of rising and falling
//! inputs is kept over some cycles: memory of the plant, which the model does not know, shows there.

use crate::matrix::Vector;
use crate::outcome::{Alarm, Estimate, Status, Update};
use crate::setup::{MAX_INPUTS, MAX_ROWS, Measurement, Setup};

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

/// Time constant of the noise per direction (s): some cycles.
const CYCLES_S: f64 = 10.0;
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
pub(crate) struct Watch {
    last_t_s: Option<f64>,
    /// Begin of the present contradiction.
    since_s: Option<f64>,
    readings: f64,
    /// Readings that were not used.
    unexplained: f64,
    /// Values per block.
    seen: [f64; MAX_ROWS],
    /// Rejected values per block.
    rejected: [f64; MAX_ROWS],
    /// Readings used.
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

impl Watch {
    /// Adds the outcome of a reading. `noise` is that of the measured inputs, in order; `None` if the reading was not used.
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

    /// Contradiction that has lasted for `SETTLE_S`. `estimates` come with their standard deviations without any reading;
    /// `may_be_memory`: memory of the plant may be what contradicts.
    pub(crate) fn judge(
        &mut self,
        setup: &Setup,
        estimates: impl Iterator<Item = (Estimate, f64)>,
        may_be_memory: bool,
    ) -> Option<Alarm> {
        let (found, now_s) = (self.misfit(setup, estimates, may_be_memory), self.last_t_s?);
        self.since_s = found.and(self.since_s.or(Some(now_s)));
        found.filter(|_| self.since_s.is_some_and(|since| now_s - since >= SETTLE_S))
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
            let is_told = away.all(|(at, ((estimate, unread), unknown))| {
                let off = (estimate.value - unknown.prior).abs();
                off <= MAX_FROM_PRIOR_OF_WITNESSES * unread || setup.is_moving(at)
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
        if differs {
            return Some(Alarm::NotExplained);
        }
        let mut unknowns = 0_u32;
        for (at, ((estimate, unread), unknown)) in estimates.zip(&setup.unknowns).enumerate() {
            let away = (estimate.value - unknown.prior).abs() > MAX_FROM_PRIOR * unread;
            unknowns |= u32::from(estimate.identifiable && away && !setup.is_moving(at)) << at;
        }
        (unknowns != 0).then_some(Alarm::Unknown(unknowns))
    }
}
