//! A gap or a bias that has drifted farther than expected, as the explanation of rejected values before a sensor is blamed.
//!
//! When values have been rejected for [`BEGIN_S`], the filter lets go of what may drift in a setup and is no motion: its variances are
//! those of the priors again. If the readings of the next [`LENGTH_S`] are then explained, that is what has changed, and the estimates
//! stay. Otherwise the filter returns to the estimates from before, and whatever is rejected is to blame.

use crate::matrix::{Symmetric, Vector};
use crate::setup::{Setup, Status, Update};

/// Duration of rejections before a trial, and that of the trial, s.
pub(crate) const BEGIN_S: f64 = 0.35;
const LENGTH_S: f64 = 0.7;
/// Smallest number of readings of a trial.
const MIN_READINGS: u32 = 5;
/// Change, in standard deviations before the trial, from which an unknown is what has drifted.
const DRIFTED: f64 = 3.0;

/// Estimates from before a trial, and what its readings said.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Trial {
    begin_s: f64,
    pub(crate) mean: Vector,
    pub(crate) covariance: Symmetric,
    pub(crate) gap_floor_mm: f64,
    readings: u32,
    explained: u32,
}

/// Unknowns that a trial lets go.
pub(crate) fn released(setup: &Setup) -> impl Iterator<Item = usize> + '_ {
    let drifts = |index: &usize| setup.unknowns[*index].drift_per_sqrt_s > 0.0 && !setup.is_moving(*index);
    (0..setup.unknowns.len()).filter(drifts)
}

impl Trial {
    pub(crate) fn new(begin_s: f64, mean: Vector, covariance: Symmetric, gap_floor_mm: f64) -> Self {
        Self { begin_s, mean, covariance, gap_floor_mm, readings: 0, explained: 0 }
    }

    /// Adds the outcome of a reading. At the end of the trial it says whether most readings are explained.
    pub(crate) fn add(&mut self, t_s: f64, update: &Update) -> Option<bool> {
        self.readings += 1;
        self.explained += u32::from(update.status == Status::Used && update.rejected == 0);
        let is_over = t_s - self.begin_s >= LENGTH_S && self.readings >= MIN_READINGS;
        is_over.then_some(2 * self.explained > self.readings)
    }

    /// Variance of an unknown without the trial, at a later time.
    pub(crate) fn variance(&self, setup: &Setup, unknown: usize, t_s: f64) -> f64 {
        self.covariance.get(unknown, unknown) + setup.unknowns[unknown].drift_variance(t_s - self.begin_s)
    }

    /// Unknowns that are elsewhere now, one bit each.
    pub(crate) fn drifted(&self, setup: &Setup, mean: &Vector, t_s: f64) -> u32 {
        let is_elsewhere = |index: &usize| {
            let off = mean[*index] - self.mean[*index];
            off * off > DRIFTED * DRIFTED * self.variance(setup, *index, t_s)
        };
        released(setup).filter(is_elsewhere).fold(0, |bits, at| bits | 1 << at)
    }
}
