//! Measured values beside the model's before and after a fit, and what is left over.

use crate::batch::Fit;
use crate::filter::Filter;
use crate::setup::{MeasuredRow, Measurement, Model, Predicted, Setup};
use crate::structure::{ResidualSeries, Structure};

/// Predictions for each reading, by measured quantity.
pub struct Curves {
    /// With the priors, by reading.
    pub before: Vec<Vec<f64>>,
    /// With the fitted values, by reading.
    pub after: Vec<Vec<f64>>,
    /// Position and key of the first input that varies.
    driving: usize,
    driving_name: String,
}

impl Curves {
    /// With the priors and with the fitted values.
    pub fn of(
        setup: &Setup,
        readings: &[Measurement],
        fit: &Fit,
        sensors: &mut impl Model,
        keys: &[String],
    ) -> Self {
        let mut predict = |unknowns: &[f64]| -> Vec<Vec<f64>> {
            // A motion is that which explains the readings with these values.
            let mut motion = setup.swing.and_then(|_| Filter::new(setup.clone().held_at(unknowns)).ok());
            let one = |reading: &Measurement| {
                let mut rows = vec![Predicted::default(); setup.rows.len()];
                let inputs = match &mut motion {
                    Some(motion) => motion.update(reading, sensors).inputs,
                    None => setup.inputs(reading, unknowns),
                };
                sensors.predict(&inputs, &mut rows);
                let bias = |index: usize| setup.rows[index].bias.map_or(0.0, |bias| unknowns[bias]);
                rows.iter().enumerate().map(|(index, row)| row.value + bias(index)).collect()
            };
            readings.iter().map(one).collect()
        };
        let before: Vec<f64> = setup.unknowns.iter().map(|unknown| unknown.prior).collect();
        let after: Vec<f64> = fit.estimates.iter().map(|estimate| estimate.value).collect();
        let varies = |index: &usize| {
            readings.windows(2).any(|pair| (pair[0].inputs[*index] - pair[1].inputs[*index]).abs() > 0.0)
        };
        let driving = (0..keys.len()).find(varies).unwrap_or(0);
        let driving_name = keys.get(driving).cloned().unwrap_or_default();
        Self { before: predict(&before), after: predict(&after), driving, driving_name }
    }

    /// Structure of the residuals by measured quantity.
    pub fn structures(&self, setup: &Setup, readings: &[Measurement]) -> Vec<(String, Structure)> {
        let t_s: Vec<f64> = readings.iter().map(|reading| reading.t_s).collect();
        let driving: Vec<f64> = readings.iter().map(|reading| reading.inputs[self.driving]).collect();
        let of_row = |(index, row): (usize, &MeasuredRow)| {
            let measured: Vec<f64> = readings.iter().map(|reading| reading.rows[index]).collect();
            let predicted: Vec<f64> = self.after.iter().map(|rows| rows[index]).collect();
            let sigma = row.variance(1.0).sqrt();
            let series = ResidualSeries {
                t_s: &t_s,
                measured: &measured,
                predicted: &predicted,
                driving: &driving,
                sigma,
            };
            Some((row.name.clone(), Structure::of(series)?))
        };
        setup.rows.iter().enumerate().filter_map(of_row).collect()
    }

    /// Why a fit explains nothing, with the largest fraction of values that may contradict it; empty if it does explain the readings.
    #[must_use]
    pub fn reasons(&self, fit: &Fit, structures: &[(String, Structure)], max_rejected: f64) -> Vec<String> {
        let values = fit.used + fit.outliers;
        let mut reasons = Vec::new();
        if fit.outliers as f64 > max_rejected * values as f64 {
            reasons.push(format!(
                "{} of {values} values contradict the fit, more than {max_rejected} of them",
                fit.outliers
            ));
        }
        if let Some(alarm) = fit.alarm {
            reasons.push(format!("the alarm of the filter over the motion: {alarm}"));
        }
        for (name, found) in structures.iter().filter(|(_, found)| found.is_unexplained) {
            let mut shape = vec![format!("{:.3} of {:.3} RMS is no noise", found.systematic, found.rms)];
            shape.extend(found.lag_s.map(|lag_s| format!("it lags by about {lag_s:.2} s")));
            shape.extend(found.drift_per_s.map(|drift| format!("it drifts by {drift:.2e} per s")));
            if found.loop_share.abs() > 0.01 {
                shape.push(format!(
                    "rising and falling {} differ by {:.1} % of the range",
                    self.driving_name,
                    100.0 * found.loop_share.abs()
                ));
            }
            reasons.push(format!("{name}: {}", shape.join(", ")));
        }
        reasons
    }
}
