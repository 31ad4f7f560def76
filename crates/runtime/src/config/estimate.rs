//! Estimated quantities of an actuator, and the noise of its sensors.

use control::held::{FORCE_SIGMA_N, MarkerSpec};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use wire::layout::{MARKERS_MAX, Marker};

/// Estimated quantities by name: a model input (`gap_mm`, `"elastomer.law.mu_mpa"`), `pressure_bias_mpa`, `force_bias_n`.
pub type EstimateSpec = BTreeMap<String, UnknownSpec>;

/// Measured observables of the model by name (`bending_angle_deg`).
pub type ObservedSpecs = BTreeMap<String, ObservedSpec>;

/// A measured observable: the readings carry it by its name.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObservedSpec {
    /// Standard deviation of the noise of a reading, in the observable's unit; a sensor's own goes before it.
    pub sigma: f64,
    /// Standard deviation of the model's value; default: from its half-width, which excludes the error of its mesh.
    pub model_sigma: Option<f64>,
}

/// Prior of an estimated quantity, in its own unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UnknownSpec {
    /// Value.
    pub prior: f64,
    /// Standard deviation.
    pub sigma: f64,
    /// Standard deviation by which it drifts in the first second (in `t` seconds by `drift sqrt(t)`); 0: constant.
    #[serde(default)]
    pub drift: f64,
}

/// Standard deviations of the sensors' noise and of the model, and the correlation time of the model's error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SigmaSpec {
    /// Standard deviation of a pressure reading, MPa.
    pub pressure_mpa: f64,
    /// Standard deviation of the change of the pressure's rate in a second, MPa/s: field and force then belong to the pressure
    /// estimated from all readings. Default: the pressure of each reading alone.
    pub pressure_rate_mpa_per_s: Option<f64>,
    /// Standard deviation of a gap reading, mm.
    pub gap_mm: f64,
    /// Standard deviation of a load cell's reading, N.
    pub force_n: f64,
    /// Standard deviation of a marker's coordinate, mm.
    pub marker_mm: f64,
    /// Standard deviation of the model's force, N; default: from the model's half-width, which excludes the error of its mesh.
    pub model_force_n: Option<f64>,
    /// Standard deviation of the model's positions, mm; default as above.
    pub model_mm: Option<f64>,
    /// Time over which the model's error stays alike, s: readings within it do not average it out.
    pub model_correlation_s: f64,
}

impl Default for SigmaSpec {
    fn default() -> Self {
        Self {
            pressure_mpa: 0.0005,
            pressure_rate_mpa_per_s: None,
            gap_mm: 0.2,
            force_n: FORCE_SIGMA_N,
            marker_mm: 0.2,
            model_force_n: None,
            model_mm: None,
            model_correlation_s: 10.0,
        }
    }
}

/// Where the camera's frame lies in the actuator's frame: `actuator = R camera + position`, with `R` the turns about x, then
/// y, then z.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CameraSpec {
    /// Origin of the camera's frame, mm.
    pub position_mm: [f64; 3],
    /// Turns about the actuator's x, y and z axes, in this order, in degrees.
    pub rotation_deg: [f64; 3],
}

impl CameraSpec {
    /// The matrix `R`, row by row.
    pub fn rotation(&self) -> [[f64; 3]; 3] {
        let [(sx, cx), (sy, cy), (sz, cz)] = self.rotation_deg.map(|angle| angle.to_radians().sin_cos());
        [
            [cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
            [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
            [-sy, cy * sx, cy * cx],
        ]
    }

    /// A measured position in the actuator's frame, mm.
    pub fn in_actuator_mm(&self, Marker { x, y, z }: Marker) -> [f64; 3] {
        let ([rows_x, rows_y, rows_z], [ox, oy, oz]) = (self.rotation(), self.position_mm);
        [(rows_x, ox), (rows_y, oy), (rows_z, oz)].map(|([a, b, c], origin)| a * x + b * y + c * z + origin)
    }
}

/// Names of estimated quantities that are no model input.
pub const BIASES: [&str; 2] = [PRESSURE_BIAS, "force_bias_n"];
/// The pressure gauge's bias: where it is estimated, so is the pressure.
pub(crate) const PRESSURE_BIAS: &str = "pressure_bias_mpa";

/// Errors in the estimation of an actuator that the scene alone shows.
pub(super) fn problems(
    place: &str,
    estimate: &EstimateSpec,
    sigma: &SigmaSpec,
    markers: &[MarkerSpec],
    observables: &ObservedSpecs,
    camera: &CameraSpec,
    problems: &mut Vec<String>,
) {
    let mut expect = |fits: bool, key: String, expected: &str, found: String| {
        if !fits {
            problems.push(format!("{place}.{key}: expected {expected}, found {found}"));
        }
    };
    for (name, unknown) in estimate {
        let finite = unknown.prior.is_finite();
        expect(finite, format!("estimate.{name}.prior"), "a finite number", unknown.prior.to_string());
        let positive = unknown.sigma.is_finite() && unknown.sigma > 0.0;
        expect(positive, format!("estimate.{name}.sigma"), "a number above 0", unknown.sigma.to_string());
        let drift = unknown.drift.is_finite() && unknown.drift >= 0.0;
        expect(drift, format!("estimate.{name}.drift"), "0 or more", unknown.drift.to_string());
    }
    for (key, value) in [
        ("pressure_mpa", sigma.pressure_mpa),
        ("pressure_rate_mpa_per_s", sigma.pressure_rate_mpa_per_s.unwrap_or(1.0)),
        ("gap_mm", sigma.gap_mm),
        ("force_n", sigma.force_n),
        ("marker_mm", sigma.marker_mm),
        ("model_force_n", sigma.model_force_n.unwrap_or(1.0)),
        ("model_mm", sigma.model_mm.unwrap_or(1.0)),
    ] {
        let fits = value.is_finite() && value > 0.0;
        expect(fits, format!("sigma.{key}"), "a number above 0", value.to_string());
    }
    for (name, observed) in observables {
        for (key, value) in [("sigma", observed.sigma), ("model_sigma", observed.model_sigma.unwrap_or(1.0))]
        {
            let fits = value.is_finite() && value > 0.0;
            expect(fits, format!("observables.{name}.{key}"), "a number above 0", value.to_string());
        }
    }
    let correlation = sigma.model_correlation_s;
    let fits = correlation.is_finite() && correlation >= 0.0;
    expect(fits, "sigma.model_correlation_s".into(), "0 or more", correlation.to_string());
    expect(markers.len() <= MARKERS_MAX, "marker".into(), "at most 8 markers", markers.len().to_string());
    for (at, marker) in markers.iter().enumerate() {
        let found = match (marker.node, marker.at_mm) {
            (Some(_), Some(_)) => "both",
            (None, None) => "neither",
            _ => continue,
        };
        expect(false, format!("marker[{at}]"), "either `node` or `at_mm`", found.into());
    }
    let finite = camera.position_mm.iter().chain(&camera.rotation_deg).all(|value| value.is_finite());
    expect(finite, "camera".into(), "finite numbers", format!("{camera:?}"));
}

/// Standard deviations of the noise of a reading's values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Sigmas {
    pub(crate) pressure_mpa: f64,
    pub(crate) gap_mm: f64,
    pub(crate) force_n: f64,
    pub(crate) markers_mm: [Marker; MARKERS_MAX],
}

#[cfg(test)]
#[path = "../../tests/unit/config_estimate.rs"]
mod tests;
