//! Motion on a static model: inertial loads as further inputs of the equilibrium, and a few linear modes.
//!
//! A static family `x = X(P, gap, a)` is sampled over uniform accelerations `a_i` along unit vectors `e_i` whose inertial forces
//! `M e_i a_i` load the body; `g_i` are their values at rest. With the linear modes `phi_k`, `w_k` of a regime (M-normalised) the
//! motion is `x = X(P, gap, a) + sum_k phi_k y_k`, and tested with its tangents `X_i = dX/da_i`
//!
//! ```text
//! X_i'   M x'' = sum_j (g_j - a_j) X_i' M e_j   - sum_k (phi_k' M e_i) y_k - beta e_i'  M x'
//! phi_k' M x'' = sum_j (g_j - a_j) phi_k' M e_j - w_k^2 y_k                - beta w_k^2 phi_k' M x'
//! ```
//!
//! No stiffness appears, because `K X_i = M e_i`. Coordinates `q = Psi' M (x - x_0)` over M-orthonormal modes `Psi` make `M` the
//! identity. [`stepper`] integrates, [`manifold`] is what it needs to know of a family, [`model_motion`] moves a trained model.

pub mod data;
pub mod manifold;
pub mod model_motion;
mod momenta;
pub mod stepper;
