//! Motion on a static model: the inertial load as one more input of the equilibrium, and a few linear modes.
//!
//! A static family `x = X(P, gap, a)` is sampled over the uniform acceleration `a` along the unit vector `e` whose inertial force
//! `M e a` loads the body; `g` is its value at rest. With the linear modes `phi_k`, `w_k` of a regime (M-normalised) the
//! motion is `x = X(P, gap, a) + sum_k phi_k y_k`, and tested with its tangents
//!
//! ```text
//! X_a'   M x'' = (g - a) X_a' M e   - sum_k (phi_k' M e) y_k - beta e'    M x'
//! phi_k' M x'' = (g - a) phi_k' M e - w_k^2 y_k              - beta w_k^2 phi_k' M x'
//! ```
//!
//! No stiffness appears, because `K X_a = M e`. Coordinates `q = Psi' M (x - x_0)` over M-orthonormal modes `Psi` make `M` the
//! identity. [`stepper`] integrates, [`manifold`] is what it needs to know of a family, [`model_motion`] moves a trained model.

pub mod data;
pub mod manifold;
pub mod model_motion;
mod momenta;
pub mod stepper;
