//! Pneumatic line with an orifice by ISO 6358: choked and subsonic flow into a volume at constant temperature.

use super::line::Line;
use serde::{Deserialize, Serialize};

/// Pressure of the atmosphere, MPa: inputs are gauge pressures.
const ATMOSPHERE_MPA: f64 = 0.101_325;
/// Pressure ratio from which the flow is laminar, in proportion to the difference.
const LAMINAR: f64 = 0.99;

/// Flow `c' = +-(p_up / T) psi(p_down / p_up)` of absolute pressures, with `psi = 1` up to the critical ratio `b` and
/// `psi = sqrt(1 - ((r - b) / (1 - b))^2)` above it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Orifice {
    /// `T = V / (C p_0)`, s, of the volume `V`, the sonic conductance `C` and the reference pressure `p_0` of 0.1 MPa.
    pub time_s: f64,
    /// Critical pressure ratio `b`.
    pub critical_ratio: f64,
}

impl Orifice {
    /// Lag with the orifice's flow at these gauge pressures, MPa.
    fn lag(&self, cavity_mpa: f64, input_mpa: f64) -> Line {
        let (up, down) =
            (cavity_mpa.max(input_mpa) + ATMOSPHERE_MPA, cavity_mpa.min(input_mpa) + ATMOSPHERE_MPA);
        let laminar_s = self.time_s * (1.0 - LAMINAR) / self.flow(LAMINAR);
        let is_laminar = up <= 0.0 || down >= LAMINAR * up;
        let lag_s =
            if is_laminar { laminar_s } else { self.time_s * (up - down) / (up * self.flow(down / up)) };
        Line { fill_s: lag_s, empty_s: lag_s }
    }

    /// `psi`.
    fn flow(&self, ratio: f64) -> f64 {
        let subsonic = (ratio - self.critical_ratio).max(0.0) / (1.0 - self.critical_ratio);
        (1.0 - subsonic * subsonic).sqrt()
    }

    /// Lag of a step in which the input goes straight from `from` to `to`: that of its middle. Second order; stable at any step.
    pub(super) fn within(&self, output: f64, from: f64, to: f64, dt_s: f64) -> Line {
        let middle = 0.5 * (from + to);
        let half = self.lag(output, from).step(output, from, middle, 0.5 * dt_s).0;
        self.lag(half, middle)
    }
}
