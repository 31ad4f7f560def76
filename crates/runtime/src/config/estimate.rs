//! Estimated quantities of an actuator, and the noise of its sensors.

use crate::problems::Problems;
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
    pub prior: f64,
    pub sigma: f64,
    /// Standard deviation by which it drifts in the first second (in `t` seconds by `drift sqrt(t)`); 0: constant. Default: what a gap or a
    /// sensor's bias may do unseen ([`UnknownSpec::drift_of`]), 0 for the rest.
    pub drift: Option<f64>,
}

impl UnknownSpec {
    /// Drift of the quantity with this name. A gap or a bias that is held constant would make a moved obstacle or a slipped gauge look like
    /// a wrong sensor.
    pub(crate) fn drift_of(&self, name: &str) -> f64 {
        self.drift.unwrap_or(match name {
            "gap_mm" => GAP_DRIFT_MM,
            PRESSURE_BIAS => PRESSURE_DRIFT_MPA,
            FORCE_BIAS => FORCE_DRIFT_N,
            _ => 0.0,
        })
    }
}

/// Standard deviations of the change in the first second where the scene says none.
const GAP_DRIFT_MM: f64 = 0.1;
const PRESSURE_DRIFT_MPA: f64 = 2e-4;
const FORCE_DRIFT_N: f64 = 5e-4;

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
    /// Standard deviation of the model's force, N; default: from the model's half-width and 1 % of the largest force for the error of its
    /// mesh.
    pub model_force_n: Option<f64>,
    /// Standard deviation of the model's positions, mm; default: from the half-width and 0.1 % of the farthest marker's travel.
    pub model_mm: Option<f64>,
    /// Time over which the model's error stays alike, s: readings within it do not average it out.
    pub model_correlation_s: f64,
    /// Time without evidence after which an alarm of the estimate ends, s.
    pub alarm_hold_s: f64,
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
            alarm_hold_s: 10.0,
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

    /// A place of the actuator's frame in the camera's, mm: the transposed rotation of the difference.
    pub(crate) fn in_camera_mm(&self, place_mm: [f64; 3]) -> [f64; 3] {
        let (rows, origin) = (self.rotation(), self.position_mm);
        let column = |pick: fn([f64; 3]) -> f64| {
            let ways = place_mm.iter().zip(origin).map(|(x, origin)| x - origin);
            rows.into_iter().zip(ways).map(|(row, way)| part(pick(row), way)).sum()
        };
        [column(|[a, ..]| a), column(|[_, b, _]| b), column(|[.., c]| c)]
    }

    /// A measured position in the actuator's frame, mm.
    pub fn in_actuator_mm(&self, Marker { x, y, z }: Marker) -> [f64; 3] {
        let ([rows_x, rows_y, rows_z], [ox, oy, oz]) = (self.rotation(), self.position_mm);
        [(rows_x, ox), (rows_y, oy), (rows_z, oz)]
            .map(|([a, b, c], origin)| part(a, x) + part(b, y) + part(c, z) + origin)
    }
}

/// Part of a coordinate in a turned frame; one that is not known, NaN, hides none that it has no part in.
fn part(factor: f64, value: f64) -> f64 {
    if factor == 0.0 { 0.0 } else { factor * value }
}

/// Names of estimated quantities that are no model input.
pub const BIASES: [&str; 2] = [PRESSURE_BIAS, FORCE_BIAS];
/// The load cell's bias.
pub(crate) const FORCE_BIAS: &str = "force_bias_n";
/// The pressure gauge's bias: where it is estimated, so is the pressure.
pub(crate) const PRESSURE_BIAS: &str = "pressure_bias_mpa";

/// Errors in the estimation of an actuator that the scene alone shows.
pub(super) fn problems(
    estimate: &EstimateSpec,
    sigma: &SigmaSpec,
    markers: &[MarkerSpec],
    observables: &ObservedSpecs,
    camera: &CameraSpec,
    problems: &mut Problems,
) {
    let above_0 = |value: f64| value.is_finite() && value > 0.0;
    for (name, unknown) in estimate {
        let mut problems = problems.part(format_args!("estimate.{name}"));
        problems.finite("prior", unknown.prior);
        problems.expect(above_0(unknown.sigma), "sigma", "a number above 0", unknown.sigma);
        problems.at_least_0("drift", unknown.drift.unwrap_or(0.0));
    }
    let mut of_sigma = problems.part("sigma");
    for (key, value) in [
        ("pressure_mpa", sigma.pressure_mpa),
        ("pressure_rate_mpa_per_s", sigma.pressure_rate_mpa_per_s.unwrap_or(1.0)),
        ("gap_mm", sigma.gap_mm),
        ("force_n", sigma.force_n),
        ("marker_mm", sigma.marker_mm),
        ("model_force_n", sigma.model_force_n.unwrap_or(1.0)),
        ("model_mm", sigma.model_mm.unwrap_or(1.0)),
    ] {
        of_sigma.expect(above_0(value), key, "a number above 0", value);
    }
    // 0: independent from reading to reading.
    if sigma.model_correlation_s != 0.0 {
        of_sigma.seconds("model_correlation_s", sigma.model_correlation_s);
    }
    of_sigma.at_least_0("alarm_hold_s", sigma.alarm_hold_s);
    for (name, observed) in observables {
        let mut problems = problems.part(format_args!("observables.{name}"));
        for (key, value) in [("sigma", observed.sigma), ("model_sigma", observed.model_sigma.unwrap_or(1.0))]
        {
            problems.expect(above_0(value), key, "a number above 0", value);
        }
    }
    let expected = format!("at most {MARKERS_MAX} markers");
    problems.expect(markers.len() <= MARKERS_MAX, "marker", &expected, markers.len());
    for (index, marker) in markers.iter().enumerate() {
        let fits = marker.node.is_some() != marker.at_mm.is_some();
        let found = if marker.node.is_some() { "both" } else { "neither" };
        problems.expect(fits, &format!("marker[{index}]"), "either `node` or `at_mm`", found);
    }
    let finite = camera.position_mm.iter().chain(&camera.rotation_deg).all(|value| value.is_finite());
    problems.expect(finite, "camera", "finite numbers", format_args!("{camera:?}"));
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
