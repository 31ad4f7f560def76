//! Reduced inertia as a model stores it.

use crate::snapshots::RegimeKind;
use serde::{Deserialize, Serialize};

/// Reduced inertia of a model whose inertial load is one of its inputs. Coordinates: `q = Psi' M (x - x_0)` over M-orthonormal modes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InertiaModel {
    /// Position of the inertial load (mm/s2) in the model's inputs.
    pub load_input: u32,
    /// Length of the inner steps, ns.
    pub step_ns: u64,
    /// Damping proportional to the stiffness, s.
    pub damping_s: f64,
    /// Inertial force of a unit acceleration, `Psi' M e`, in coordinates.
    pub unit_load: Vec<f64>,
    /// Free regime, then contact if the model has it.
    pub regimes: Vec<RegimeInertia>,
}

/// From modal coefficients of a regime to coordinates, and linear modes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RegimeInertia {
    /// Regime.
    pub kind: RegimeKind,
    /// Coordinates of the mean fields.
    pub mean: Vec<f64>,
    /// `coordinates x coefficients` of the regime; 0 for coefficients of other fields.
    pub by_coefficient: Vec<f64>,
    /// Linear modes by increasing frequency.
    pub modes: Vec<StoredMode>,
}

/// Linear mode of a regime, M-normalised.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StoredMode {
    /// Circular frequency, rad/s.
    pub rate_rad_s: f64,
    /// Shape in coordinates.
    pub shape: Vec<f64>,
    /// Shape in the regime's modal coefficients, for the fields.
    pub coefficients: Vec<f64>,
    /// Heights at the nodes of the clearance, mm; empty in contact.
    pub heights_mm: Vec<f64>,
    /// Contact force per amplitude, N; 0 when free.
    pub reaction_n: f64,
}

impl InertiaModel {
    /// Number of coordinates.
    pub fn coordinates(&self) -> usize {
        self.unit_load.len()
    }
}
