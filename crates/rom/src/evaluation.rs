//! What a query answers before any field is reconstructed: plain data, allocated once.

use crate::hull::DomainStatus;
use crate::model::HalfWidths;
use crate::snapshots::RegimeKind;

/// A checked reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Input {
    /// Cavity pressure in MPa.
    pub pressure_mpa: f64,
    /// Gap in mm; `f64::INFINITY` when there is no obstacle.
    pub gap_mm: f64,
}

/// What deserves a reader's attention. Nothing is clamped in silence: each flag says what was done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flags {
    /// The query lies outside the training hull.
    pub extrapolated: bool,
    /// The interpolated force was negative and was lifted to 0.
    pub force_clamped: bool,
    /// The label still says contact although the pressure is just below the onset.
    pub held_by_hysteresis: bool,
}

/// The answer to one query. Reused between calls: [`crate::predict::Predictor::evaluation`] sizes it.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluation {
    /// The query.
    pub input: Input,
    /// Label, with hysteresis.
    pub regime: RegimeKind,
    /// Regime whose basis the coefficients belong to (the physics; it differs from `regime` only while the label is
    /// held by hysteresis).
    pub basis: RegimeKind,
    /// Modal coefficients of `basis`, group after group.
    pub coefficients: Vec<f64>,
    /// Their derivatives by pressure, per MPa.
    pub dcoefficients_dpressure: Vec<f64>,
    /// Their derivatives by gap, per mm.
    pub dcoefficients_dgap: Vec<f64>,
    /// Contact force in N, never negative.
    pub contact_force_n: f64,
    /// dF/dP in N/MPa.
    pub dforce_dpressure: f64,
    /// dF/dgap in N/mm.
    pub dforce_dgap: f64,
    /// Onset pressure of this gap in MPa: 0 when the actuator's own weight touches, none when out of reach.
    pub onset_pressure_mpa: Option<f64>,
    /// Where the query lies with respect to the training samples of `basis`.
    pub domain: DomainStatus,
    /// Distance to the training hull over inputs scaled to [0, 1]; 0 inside.
    pub domain_distance: f64,
    /// Coverage bars of `basis`.
    pub bars: HalfWidths,
    /// Flags.
    pub flags: Flags,
}
