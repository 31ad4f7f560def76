//! Residuals of the markers: measured minus predicted positions, in the camera's frame.

use super::residual::{Residual, ResidualVerdict, ResidualWatch};
use crate::config::ActuatorSpec;
use crate::estimation::{MarkerModel, NewValues};
use estimate::{MAX_ROWS, Model, Predicted};
use rom::evaluation::Evaluation;
use wire::SensorSample;
use wire::layout::{MARKERS_MAX, Marker};

/// Markers of an actuator with the model's predictions of them.
#[derive(Debug)]
pub(super) struct Markers {
    model: MarkerModel,
    predicted: [Predicted; MAX_ROWS],
    count: usize,
    sigmas_mm: [Marker; MARKERS_MAX],
    watches: [[ResidualWatch; 3]; MARKERS_MAX],
    judged: [ResidualVerdict; MARKERS_MAX],
}

impl Markers {
    pub(super) fn new(model: MarkerModel, spec: &ActuatorSpec) -> Self {
        Self {
            model,
            predicted: [Predicted::default(); MAX_ROWS],
            count: spec.markers.len().min(MARKERS_MAX),
            sigmas_mm: spec.marker_sigmas_mm(),
            watches: Default::default(),
            judged: [ResidualVerdict::default(); MARKERS_MAX],
        }
    }

    /// Takes the markers of a reading with this evaluation: the contribution to the displacement's half-width, mm, which is the largest of
    /// the markers, and whether a coordinate contradicts the model for `after_s`. A slow camera's value counts once.
    pub(super) fn update(
        &mut self,
        sample: &SensorSample,
        new: &NewValues,
        evaluation: &Evaluation,
        after_s: f64,
    ) -> ResidualVerdict {
        if sample.marker_values > 0 {
            let rows = self.predicted.get_mut(..1 + 3 * self.count).unwrap_or_default();
            match &mut self.model {
                MarkerModel::Mesh(model) => {
                    model.predict(evaluation.inputs.values(), rows);
                }
                MarkerModel::Learned(markers) => {
                    let values = rows.iter_mut().skip(1).zip(markers.places(evaluation).flatten());
                    values.for_each(|(row, value)| row.value = value);
                }
            }
        }
        let (t_sensor_ns, halfwidth) = (sample.t_sensor_ns, evaluation.halfwidths.displacement_mm);
        let predicted = self.predicted.get(1..).unwrap_or_default().chunks_exact(3);
        let markers = sample.markers_mm.iter().zip(new.markers).zip(&self.sigmas_mm).zip(predicted);
        let state = self.watches.iter_mut().zip(&mut self.judged);
        for ((((marker, is_new), sigma), predicted), (watches, judged)) in markers.zip(state).take(self.count)
        {
            let axes = [(marker.x, sigma.x), (marker.y, sigma.y), (marker.z, sigma.z)];
            if !is_new && axes.iter().any(|(measured, _)| !measured.is_nan()) {
                continue;
            }
            let each =
                axes.iter().zip(predicted).zip(watches).map(|(((measured, sigma), predicted), watch)| {
                    let value = measured - predicted.value;
                    watch.update(Residual { t_sensor_ns, value, halfwidth, sigma: *sigma }, after_s)
                });
            *judged = each.fold(ResidualVerdict::default(), |all, axis| all.joined(axis, f64::hypot));
        }
        self.judged.iter().fold(ResidualVerdict::default(), |all, marker| all.joined(*marker, f64::max))
    }
}
