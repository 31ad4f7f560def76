//! The unscented Kalman filter (Julier and Uhlmann 2004) for comparison. It is given what ours has: unknowns, priors, noise of the
//! sensors, the model's error that readings share, rejection of outliers, and our filter's decision on contact, since points on
//! both sides of the onset would average over its kink.

use super::truth::{Readings, Truth};
use estimate::{InputRole, MAX_ROWS, Measurement, Model as _, Predicted, Setup};
use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side};
use runtime::estimation::SensorModel;
use std::time::Instant;

/// Largest sum of squares of a block of one, two or three values, of a probability of 1e-4, as in ours.
const LARGEST_SQUARES: [f64; 3] = [15.14, 18.42, 21.11];
/// How far inside the contact a point is put that would lie outside, mm.
const INSIDE_CONTACT_MM: f64 = 1e-3;

pub(super) struct Unscented<'a> {
    setup: &'a Setup,
    mean: Mat<f64>,
    covariance: Mat<f64>,
    /// Time of the reading before, s.
    last_t_s: f64,
}

/// Predictions of the points, one column each, and the points' unknowns.
struct Points {
    unknowns: Mat<f64>,
    values: Mat<f64>,
}

impl<'a> Unscented<'a> {
    /// Errors of the unknowns at the end of the readings, the time of each update, us, and the readings left out: points without a
    /// prediction, or a covariance that is not positive definite. `touches`: contact per reading, by
    /// our filter.
    pub(super) fn run(
        setup: &'a Setup,
        model: &mut SensorModel,
        truth: &Truth,
        readings: &Readings,
        touches: &[bool],
    ) -> (Vec<f64>, Vec<f64>, usize) {
        let count = setup.unknowns.len();
        let mut filter = Self {
            setup,
            mean: Mat::from_fn(count, 1, |at, _| setup.unknowns[at].prior),
            covariance: Mat::from_fn(count, count, |i, j| {
                if i == j { setup.unknowns[i].sigma.powi(2) } else { 0.0 }
            }),
            last_t_s: f64::NEG_INFINITY,
        };
        let (mut update_us, mut left_out) = (Vec::new(), 0);
        for (measured, touches) in readings.measured.iter().zip(touches) {
            let begin = Instant::now();
            left_out += usize::from(filter.update(model, measured, *touches).is_none());
            update_us.push(begin.elapsed().as_secs_f64() * 1e6);
        }
        let off = truth.unknowns.iter().enumerate().map(|(index, truth)| filter.mean[(index, 0)] - truth);
        (off.collect(), update_us, left_out)
    }

    fn update(&mut self, model: &mut SensorModel, measured: &Measurement, touches: bool) -> Option<()> {
        let spacing_s = measured.t_s - self.last_t_s;
        self.last_t_s = measured.t_s;
        let shared = (self.setup.model_correlation_s / spacing_s).max(1.0);
        let points = self.points(model, measured, touches)?;
        let weight = 1.0 / points.values.ncols() as f64;
        let mean = |of: &Mat<f64>| Mat::from_fn(of.nrows(), 1, |i, _| weight * of.row(i).iter().sum::<f64>());
        let center = |of: &Mat<f64>, mean: &Mat<f64>| {
            Mat::from_fn(of.nrows(), of.ncols(), |i, j| of[(i, j)] - mean[(i, 0)])
        };
        let [before, predicted] = [mean(&points.unknowns), mean(&points.values)];
        let [by_unknown, by_value] = [center(&points.unknowns, &before), center(&points.values, &predicted)];
        let spread = &by_value * by_value.transpose() * faer::Scale(weight);
        let residual: Vec<f64> =
            (0..self.setup.rows.len()).map(|row| measured.rows[row] - predicted[(row, 0)]).collect();
        let kept = self.kept(&residual, &spread)?;
        let innovation = Mat::from_fn(kept.len(), 1, |i, _| residual[kept[i]]);
        let variance = Mat::from_fn(kept.len(), kept.len(), |i, j| {
            spread[(kept[i], kept[j])] + if i == j { self.setup.rows[kept[i]].variance(shared) } else { 0.0 }
        });
        let cross = &by_unknown * by_value.transpose() * faer::Scale(weight);
        let cross = Mat::from_fn(cross.nrows(), kept.len(), |i, j| cross[(i, kept[j])]);
        let factor = Llt::new(variance.as_ref(), Side::Lower).ok()?;
        let gain = factor.solve(cross.transpose()).transpose().to_owned();
        // From the moved points, so that the result is a covariance.
        self.mean = before + &gain * innovation;
        let spread = &by_unknown * by_unknown.transpose() * faer::Scale(weight) - &gain * cross.transpose();
        self.covariance =
            Mat::from_fn(spread.nrows(), spread.ncols(), |i, j| 0.5 * (spread[(i, j)] + spread[(j, i)]));
        for (index, unknown) in self.setup.unknowns.iter().enumerate() {
            self.mean[(index, 0)] = self.mean[(index, 0)].clamp(unknown.range[0], unknown.range[1]);
        }
        Some(())
    }

    /// The points at one standard deviation times the root of their dimension, in unknowns and noise of the measured inputs.
    fn points(&self, model: &mut SensorModel, measured: &Measurement, touches: bool) -> Option<Points> {
        let noise: Vec<(usize, f64)> = self.setup.measured_inputs().collect();
        let count = self.mean.nrows();
        let (size, factor) = (count + noise.len(), Llt::new(self.covariance.as_ref(), Side::Lower).ok()?);
        let scale = (size as f64).sqrt();
        let mut out = Points {
            unknowns: Mat::zeros(count, 2 * size),
            values: Mat::zeros(self.setup.rows.len(), 2 * size),
        };
        for column in 0..2 * size {
            let (direction, sign) = (column / 2, if column % 2 == 0 { scale } else { -scale });
            let mut at = *measured;
            let mut unknowns: Vec<f64> = (0..count).map(|i| self.mean[(i, 0)]).collect();
            if direction < count {
                unknowns.iter_mut().enumerate().for_each(|(i, x)| *x += sign * factor.L()[(i, direction)]);
            } else {
                let (input, sigma) = noise[direction - count];
                at.inputs[input] -= sign * sigma;
            }
            let values = self.values(model, &at, &mut unknowns, touches);
            for (row, value) in values.iter().enumerate().take(self.setup.rows.len()) {
                out.values[(row, column)] = value.is_finite().then_some(*value)?;
            }
            unknowns.iter().enumerate().for_each(|(i, x)| out.unknowns[(i, column)] = *x);
        }
        Some(out)
    }

    /// Sensor values at a point, which is moved to the reading's side of the onset.
    fn values(
        &self,
        model: &mut SensorModel,
        at: &Measurement,
        unknowns: &mut [f64],
        touches: bool,
    ) -> [f64; MAX_ROWS] {
        for (x, unknown) in unknowns.iter_mut().zip(&self.setup.unknowns) {
            *x = x.clamp(unknown.range[0], unknown.range[1]);
        }
        let mut inputs = self.setup.inputs(at, unknowns);
        if let Some(gap) = self.setup.gap {
            let onset_mm = model.onset_gap_mm(&inputs);
            if !touches {
                inputs[gap] = f64::INFINITY;
            } else if let Some(onset_mm) = onset_mm {
                inputs[gap] = inputs[gap].min(onset_mm - INSIDE_CONTACT_MM);
                if let InputRole::Estimated(unknown) = self.setup.inputs[gap] {
                    unknowns[unknown] = inputs[gap];
                }
            }
        }
        let mut predicted = [Predicted::default(); MAX_ROWS];
        model.predict(&inputs, &mut predicted[..self.setup.rows.len()]);
        let mut out = [0.0; MAX_ROWS];
        for (out, (row, predicted)) in out.iter_mut().zip(self.setup.rows.iter().zip(&predicted)) {
            *out = predicted.value + row.bias.map_or(0.0, |bias| unknowns[bias]);
        }
        out
    }

    /// Rows that were measured and, block by block, do not contradict the prediction.
    fn kept(&self, residual: &[f64], spread: &Mat<f64>) -> Option<Vec<usize>> {
        let mut out = Vec::new();
        for block in 0..=self.setup.rows.last()?.block {
            let in_block = |row: &usize| self.setup.rows[*row].block == block && residual[*row].is_finite();
            let rows: Vec<usize> = (0..self.setup.rows.len()).filter(in_block).collect();
            let Some(limit) = rows.len().checked_sub(1).and_then(|at| LARGEST_SQUARES.get(at)) else {
                continue;
            };
            let variance = Mat::from_fn(rows.len(), rows.len(), |i, j| {
                spread[(rows[i], rows[j])] + if i == j { self.setup.rows[rows[i]].variance(1.0) } else { 0.0 }
            });
            let off = Mat::from_fn(rows.len(), 1, |i, _| residual[rows[i]]);
            let solved = Llt::new(variance.as_ref(), Side::Lower).ok()?.solve(&off);
            if (off.transpose() * solved)[(0, 0)] <= *limit {
                out.extend(rows);
            }
        }
        (!out.is_empty()).then_some(out)
    }
}
