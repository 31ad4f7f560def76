//! Static family of equilibria on which a body moves.

use crate::inputs::Inputs;
use crate::snapshots::RegimeKind;

/// Largest number of M-orthonormal coordinates.
pub const MAX_COORDINATES: usize = 16;
/// Largest number of inertial loads.
pub const MAX_LOADS: usize = 3;
/// Largest number of linear modes of a regime.
pub const MAX_LINEAR_MODES: usize = 4;

/// Values over the M-orthonormal coordinates, mm t^1/2; unused entries are 0.
pub type Coordinates = [f64; MAX_COORDINATES];
/// Amplitudes of the linear modes, mm t^1/2; unused entries are 0.
pub type Amplitudes = [f64; MAX_LINEAR_MODES];
/// Derivatives of the position with respect to the loads, per mm/s2; unused entries are 0.
pub type Tangents = [Coordinates; MAX_LOADS];

/// Scalar product over the coordinates.
pub(super) fn dot(a: &Coordinates, b: &Coordinates) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Inertial load: uniform acceleration along one axis.
#[derive(Clone, Debug, PartialEq)]
pub struct InertialLoad {
    /// Position of the load (mm/s2) in the inputs. Its value in a reading is the load at rest.
    pub input: usize,
    /// Inertial force of a unit acceleration, `Psi' M e`, in coordinates.
    pub unit: Coordinates,
    /// Smallest and largest load of the training states, mm/s2.
    pub range: [f64; 2],
}

/// Linear mode of a regime, constant over its states.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearMode {
    /// Circular frequency, rad/s.
    pub rate_rad_s: f64,
    /// M-normalised shape in coordinates.
    pub shape: Coordinates,
}

/// Equilibrium under loads and its derivatives with respect to them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Equilibrium {
    /// Position in coordinates.
    pub position: Coordinates,
    /// Derivatives of the position with respect to the loads.
    pub tangents: Tangents,
    /// Derivative of the position with respect to the pressure, per MPa.
    pub by_pressure: Coordinates,
}

/// Contact force of an equilibrium with linear modes, and its derivatives.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlateForce {
    /// Force, N; negative where the body would have to be held.
    pub n: f64,
    /// Derivatives with respect to the loads, N per mm/s2.
    pub by_load: [f64; MAX_LOADS],
    /// Derivative with respect to the gap, N/mm.
    pub by_gap: f64,
    /// Derivatives with respect to the amplitudes, N per mm t^1/2.
    pub by_amplitude: Amplitudes,
}

/// Equilibria under pressure, gap and inertial loads, in each regime also a little beyond the onset of contact. By default without an
/// obstacle and linear modes.
pub trait Manifold {
    /// Forgets states at which a search would begin: a motion at rest does not depend on those before it.
    fn forget(&mut self) {}

    /// Inertial loads, at least one and at most [`MAX_LOADS`]; landing is sought along the first.
    fn loads(&self) -> &[InertialLoad];

    /// Linear modes of a regime, by increasing frequency, at most [`MAX_LINEAR_MODES`].
    fn modes(&self, _: RegimeKind) -> &[LinearMode] {
        &[]
    }

    /// Equilibrium of a regime; `inputs` contain the loads.
    fn equilibrium(&mut self, regime: RegimeKind, inputs: &Inputs) -> Equilibrium;

    /// Distance of the lowest point of a free shape from the obstacle, mm: negative if it would penetrate, infinite without
    /// an obstacle.
    fn clearance_mm(&mut self, _: &Inputs, _: &Amplitudes) -> f64 {
        f64::INFINITY
    }

    /// First load at which the free equilibrium touches the obstacle, sought near that of the inputs.
    fn onset_load(&mut self, inputs: &Inputs) -> f64 {
        inputs.values()[self.loads()[0].input]
    }

    /// Contact force of the contact regime.
    fn force(&mut self, _: &Inputs, _: &Amplitudes) -> PlateForce {
        PlateForce::default()
    }
}
