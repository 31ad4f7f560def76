//! Residuals of the markers: measured minus predicted positions, in the camera's frame.

use super::residual::Seen;
use crate::config::ActuatorSpec;
use crate::estimation::{SensorModel, Used};
use estimate::{MAX_ROWS, Model, Predicted};
use rom::inputs::Inputs;
use wire::SensorSample;
use wire::layout::{MARKERS_MAX, Marker};

/// Markers of an actuator with the model's predictions of them.
#[derive(Debug)]
pub(super) struct Markers {
    model: SensorModel,
    predicted: [Predicted; MAX_ROWS],
    count: usize,
    sigmas_mm: [Marker; MARKERS_MAX],
    used: Used,
    seen: [[Seen; 3]; MARKERS_MAX],
}

impl Markers {
    pub(super) fn new(model: SensorModel, spec: &ActuatorSpec) -> Self {
        Self {
            model,
            predicted: [Predicted::default(); MAX_ROWS],
            count: spec.markers.len().min(MARKERS_MAX),
            sigmas_mm: spec.marker_sigmas_mm(),
            used: Used::default(),
            seen: [[Seen::default(); 3]; MARKERS_MAX],
        }
    }

    /// Takes the markers of a reading whose model inputs are these: the contribution to the displacement's half-width, mm:
    /// the largest of the markers.
    pub(super) fn update(&mut self, sample: &SensorSample, inputs: Inputs) -> f64 {
        let new = self.used.new_in(sample);
        if sample.marker_values > 0 {
            let rows = self.predicted.get_mut(..1 + 3 * self.count).unwrap_or_default();
            self.model.predict(inputs.values(), rows);
        }
        let predicted = self.predicted.get(1..).unwrap_or_default().chunks_exact(3);
        let markers = sample.markers_mm.iter().zip(new.markers).zip(&self.sigmas_mm).zip(&mut self.seen);
        let mut most_mm = 0.0_f64;
        for ((((marker, is_new), sigma), seen), predicted) in markers.zip(predicted).take(self.count) {
            let marker = if is_new { *marker } else { Marker::ABSENT };
            let axes = [(marker.x, sigma.x), (marker.y, sigma.y), (marker.z, sigma.z)];
            let parts = axes.iter().zip(predicted).zip(seen).map(|(((measured, sigma), predicted), seen)| {
                seen.update(sample.t_sensor_ns, measured - predicted.value, *sigma)
            });
            most_mm = most_mm.max(parts.fold(0.0, f64::hypot));
        }
        most_mm
    }
}
