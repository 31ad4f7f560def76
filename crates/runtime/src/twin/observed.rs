//! Residuals of the measured observables: measured minus predicted values.

use super::residual::{Residual, ResidualVerdict, Watch};
use crate::config::ActuatorSpec;
use crate::estimation::LastUsed;
use rom::evaluation::Evaluation;
use rom::observable::Observables;
use wire::SensorSample;
use wire::layout::{OBSERVABLES_MAX, pack_slot};

/// The measured observables of an actuator.
#[derive(Debug)]
pub(super) struct MeasuredObservables {
    all: Vec<ObservableWatch>,
    used: LastUsed,
}

#[derive(Debug)]
struct ObservableWatch {
    /// Name as readings carry it.
    name: [u8; 32],
    /// Position among the model's observables.
    at: usize,
    sigma: f64,
    watch: Watch,
    judged: ResidualVerdict,
}

impl MeasuredObservables {
    /// Those of the scene, at these positions among the model's.
    pub(super) fn new(spec: &ActuatorSpec, positions: &[usize]) -> Self {
        let measured = |(name, at): (&String, &usize)| ObservableWatch {
            name: pack_slot(name),
            at: *at,
            sigma: spec.named_sigma(name).unwrap_or(f64::NAN),
            watch: Watch::default(),
            judged: ResidualVerdict::default(),
        };
        Self {
            all: spec.observables.keys().zip(positions).map(measured).collect(),
            used: LastUsed::default(),
        }
    }

    /// Takes those of a reading with this evaluation; true if one contradicts the model for `after_s`. A slow sensor's value counts once.
    pub(super) fn update(
        &mut self,
        sample: &SensorSample,
        evaluation: &Evaluation,
        observables: &Observables,
        after_s: f64,
    ) -> bool {
        if self.all.is_empty() {
            return false;
        }
        let new = self.used.new_in(sample);
        for ObservableWatch { name, at, sigma, watch, judged } in &mut self.all {
            let found = sample.input(name).filter(|(_, value)| !value.is_nan());
            if found.is_some_and(|(slot, _)| new.named.get(slot) == Some(&false)) {
                continue;
            }
            let predicted = observables.value(*at, evaluation);
            let residual = Residual {
                t_sensor_ns: sample.t_sensor_ns,
                value: found.map_or(f64::NAN, |(_, measured)| measured - predicted.value),
                halfwidth: predicted.halfwidth,
                sigma: *sigma,
            };
            *judged = watch.update(residual, after_s);
        }
        self.all.iter().any(|one| one.judged.mismatch)
    }

    /// Adds what the residuals require to the half-widths of the model's observables.
    pub(super) fn widen(&self, halfwidths: &mut [f64; OBSERVABLES_MAX]) {
        for ObservableWatch { at, judged, .. } in &self.all {
            if let Some(halfwidth) = halfwidths.get_mut(*at) {
                *halfwidth = halfwidth.hypot(judged.contribution);
            }
        }
    }
}
