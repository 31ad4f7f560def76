//! Reduced inertia as a model stores it.

use crate::halfwidths::HalfWidths;
use crate::memory::PronyTerm;
use crate::snapshots::RegimeKind;
use serde::{Deserialize, Serialize};

/// Reduced inertia of a model whose inertial loads are among its inputs. Coordinates: `q = Psi' M (x - x_0)` over M-orthonormal modes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InertiaModel {
    /// Inertial loads; the body lands along the first.
    pub loads: Vec<StoredLoad>,
    /// Length of the inner steps, ns.
    pub step_ns: u64,
    /// Damping proportional to the stiffness, s.
    pub damping_s: f64,
    /// Free regime, then contact if the model has it.
    pub regimes: Vec<RegimeInertia>,
    /// Half-widths of a motion.
    pub widths: MotionWidths,
    /// Relaxation of the elastomer; the static family is the relaxed one.
    pub prony: Vec<PronyTerm>,
}

/// Inertial load as a model stores it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StoredLoad {
    /// Position of the load (mm/s2) in the model's inputs.
    pub input: u32,
    /// Inertial force of a unit acceleration, `Psi' M e`, in coordinates.
    pub unit: Vec<f64>,
}

/// What a motion leaves behind that makes its states less certain. All of it fades as a swing does. In coordinates, or in mm as the
/// mass-weighted root mean square over the body.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FadingMotion {
    /// Path of the motion.
    pub path: f64,
    /// Amplitude of what impacts took from the motion.
    pub impact: f64,
    /// Amplitude of a swing that an unknown past may have left.
    pub unknown_past: f64,
}

/// Half-widths of displacement (mm), stress (MPa) and contact force (N) per mm of an amplitude, in addition to those of the static model
/// (root of the sum of squares). Amplitudes are mass-weighted root mean squares over the body.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MotionWidths {
    /// Per path of the motion: an error of the frequency shifts the phase in proportion to it.
    pub swing: [f64; 3],
    /// Per amplitude that the velocity lost in an impact would have had.
    pub impact: [f64; 3],
    /// Per amplitude of a swing that an unknown past may have left.
    pub past: [f64; 3],
}

impl MotionWidths {
    /// Half-widths after a motion (mm), at a coverage.
    pub fn at(&self, fading_mm: &FadingMotion, coverage: f64) -> HalfWidths {
        let half_width = |k: usize| {
            let FadingMotion { path, impact, unknown_past } = *fading_mm;
            (self.swing[k] * path).hypot(self.impact[k] * impact).hypot(self.past[k] * unknown_past)
        };
        HalfWidths {
            coverage,
            displacement_mm: half_width(0),
            stress_mpa: half_width(1),
            force_n: half_width(2),
        }
    }
}

/// From modal coefficients of a regime to coordinates, and linear modes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RegimeInertia {
    /// Regime in which the body moves so.
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
        self.loads.first().map_or(0, |load| load.unit.len())
    }
}
