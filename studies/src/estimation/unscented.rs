//! The unscented Kalman filter (Julier and Uhlmann 2004) for comparison: the same unknowns, sensors and noise; one measured value after
//! the other; neither a decision on contact nor a correlated error of the model.

use super::truth::{Readings, Truth};
use estimate::{MAX_ROWS, Measurement, Model as _, Predicted, Setup};
use runtime::estimation::SensorModel;

/// A value farther from its prediction, in standard deviations, is left out.
const GATE: f64 = 3.9;

pub(super) struct Unscented {
    mean: Vec<f64>,
    covariance: Vec<Vec<f64>>,
}

impl Unscented {
    /// Errors of the unknowns at the end of the readings.
    pub(super) fn run(
        setup: &Setup,
        model: &mut SensorModel,
        truth: &Truth,
        readings: &Readings,
    ) -> Vec<f64> {
        let count = setup.unknowns.len();
        let mut covariance = vec![vec![0.0; count]; count];
        for (at, unknown) in setup.unknowns.iter().enumerate() {
            covariance[at][at] = unknown.sigma * unknown.sigma;
        }
        let mean = setup.unknowns.iter().map(|unknown| unknown.prior).collect();
        let mut filter = Self { mean, covariance };
        for measured in &readings.measured {
            filter.update(setup, model, measured);
        }
        filter.mean.iter().zip(&truth.unknowns).map(|(mean, truth)| mean - truth).collect()
    }

    fn update(&mut self, setup: &Setup, model: &mut SensorModel, measured: &Measurement) {
        let count = self.mean.len();
        // The noise of the pressure widens every value's variance by its own unscented spread.
        let noise = setup.inputs.iter().find_map(|role| match role {
            estimate::InputRole::Measured { sigma, .. } => Some(*sigma),
            _ => None,
        });
        for row in (0..setup.rows.len()).filter(|row| measured.rows[*row].is_finite()) {
            let Some(factor) = cholesky(&self.covariance) else { return };
            let scale = ((count + 1) as f64).sqrt();
            let mut points: Vec<(Vec<f64>, f64)> = Vec::new();
            for sign in [-1.0, 1.0] {
                points.extend((0..count).map(|column| {
                    let shifted =
                        self.mean.iter().zip(&factor).map(|(m, row)| m + sign * scale * row[column]);
                    (shifted.collect(), 0.0)
                }));
                points.push((self.mean.clone(), sign * scale * noise.unwrap_or(0.0)));
            }
            for (point, _) in &mut points {
                point.iter_mut().zip(&setup.unknowns).for_each(|(x, u)| *x = x.clamp(u.range[0], u.range[1]));
            }
            let values: Vec<f64> =
                points.iter().map(|(x, e)| value(setup, model, measured, x, *e, row)).collect();
            let weight = 1.0 / points.len() as f64;
            let mean = weight * values.iter().sum::<f64>();
            let mut variance = setup.rows[row].sigma.powi(2) + setup.rows[row].model_sigma.powi(2);
            let mut with = vec![0.0; count];
            for ((point, _), value) in points.iter().zip(&values) {
                variance += weight * (value - mean).powi(2);
                for ((with, x), m) in with.iter_mut().zip(point).zip(&self.mean) {
                    *with += weight * (x - m) * (value - mean);
                }
            }
            let innovation = measured.rows[row] - mean;
            if !innovation.is_finite() || innovation.abs() > GATE * variance.sqrt() {
                continue;
            }
            for i in 0..count {
                self.mean[i] += with[i] / variance * innovation;
                for j in 0..count {
                    self.covariance[i][j] -= with[i] * with[j] / variance;
                }
            }
        }
    }
}

/// The value of a row that a sensor would show.
fn value(setup: &Setup, model: &mut SensorModel, at: &Measurement, x: &[f64], noise: f64, row: usize) -> f64 {
    let mut at = *at;
    at.inputs.iter_mut().take(1).for_each(|pressure| *pressure -= noise);
    let mut rows = [Predicted::default(); MAX_ROWS];
    model.predict(&setup.inputs(&at, x), &mut rows[..setup.rows.len()]);
    rows[row].value + setup.rows[row].bias.map_or(0.0, |bias| x[bias])
}

/// `A = L L^T`; none when it is not positive definite.
fn cholesky(a: &[Vec<f64>]) -> Option<Vec<Vec<f64>>> {
    let mut l = vec![vec![0.0; a.len()]; a.len()];
    for i in 0..a.len() {
        for j in 0..=i {
            let rest = a[i][j] - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
            if i == j && !(rest > 0.0 && rest.is_finite()) {
                return None;
            }
            l[i][j] = if i == j { rest.sqrt() } else { rest / l[j][j] };
        }
    }
    Some(l)
}
