//! Residuals of the measured observables: measured minus predicted values.

use super::residual::{Residual, ResidualVerdict, ResidualWatch};
use crate::config::ActuatorSpec;
use crate::estimation::{NamedValue, NewValues};
use crate::named_outputs::NamedOutputs;
use rom::evaluation::Evaluation;
use wire::SensorSample;
use wire::layout::OBSERVABLES_MAX;

/// The measured observables of an actuator.
#[derive(Debug)]
pub(super) struct MeasuredObservables(Vec<ObservableWatch>);

#[derive(Debug)]
struct ObservableWatch {
    measured: NamedValue,
    /// Position among the model's named outputs.
    at: usize,
    sigma: f64,
    watch: ResidualWatch,
    judged: ResidualVerdict,
}

impl MeasuredObservables {
    /// Those of the scene, at these positions among the model's.
    pub(super) fn new(spec: &ActuatorSpec, positions: &[usize]) -> Self {
        let measured = |(name, at): (&String, &usize)| ObservableWatch {
            measured: NamedValue::new(name),
            at: *at,
            sigma: spec.named_sigma(name).unwrap_or(f64::NAN),
            watch: ResidualWatch::default(),
            judged: ResidualVerdict::default(),
        };
        Self(spec.observables.keys().zip(positions).map(measured).collect())
    }

    /// Takes those of a reading with this evaluation; true if one contradicts the model for `after_s`. A slow sensor's value counts once.
    pub(super) fn update(
        &mut self,
        sample: &SensorSample,
        new: &NewValues,
        evaluation: &Evaluation,
        outputs: &NamedOutputs,
        after_s: f64,
    ) -> bool {
        for ObservableWatch { measured, at, sigma, watch, judged } in &mut self.0 {
            let Some(measured) = measured.new_in(sample, new) else { continue };
            let predicted = outputs.value(*at, evaluation);
            let residual = Residual {
                t_sensor_ns: sample.t_sensor_ns,
                value: measured - predicted.value,
                halfwidth: predicted.halfwidth,
                sigma: *sigma,
            };
            *judged = watch.update(residual, after_s);
        }
        self.0.iter().any(|one| one.judged.mismatch)
    }

    /// Adds what the residuals require to the half-widths of the model's observables.
    pub(super) fn widen(&self, halfwidths: &mut [f64; OBSERVABLES_MAX]) {
        for ObservableWatch { at, judged, .. } in &self.0 {
            if let Some(halfwidth) = halfwidths.get_mut(*at) {
                *halfwidth = halfwidth.hypot(judged.contribution);
            }
        }
    }
}
