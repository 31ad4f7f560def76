//! One step of the discrete equation of motion within a regime.
//!
//! Unknowns `u = (a, y_1, ...)`, tangents `J = (X_a, phi_1, ...)`, momenta `p = J' q'`. The step is that of the discrete
//! Lagrangian with forces at the mean of both ends,
//!
//! ```text
//! J_n'     (q_n+1 - q_n) / h = p_n  + h/2 Q(J_n)
//! p_n+1 = J_n+1' (q_n+1 - q_n) / h + h/2 Q(J_n+1)
//! Q_0 = (g - a) e' X_a - sum_k (e' phi_k) y_k - beta e' q',    Q_k = (g - a) e' phi_k - w_k^2 y_k - beta w_k^2 phi_k' q'
//! ```
//!
//! with `a`, `y` the means and `q' = (q_n+1 - q_n) / h`. Second order; for a family that is linear in the load it is the trapezoidal
//! rule: stable at any step, without energy error. No second derivatives of `X` and no rate of the pressure are needed.
//!
//! A relaxing elastomer resists with `u + sum_k r_k h_k`, `h_k' = u' - h_k / tau_k`, in place of `u` (`memory/prony.rs`).

use super::manifold::{Amplitudes, Coordinates, LinearMode, MAX_LINEAR_MODES, Manifold, dot};
use crate::inputs::Inputs;
use crate::memory::{MAX_PRONY, PronyTerm};
use crate::snapshots::RegimeKind;

/// Unknowns of a step at most: load and amplitudes.
const UNKNOWNS: usize = 1 + MAX_LINEAR_MODES;
/// Newton steps; two or three are usual.
const NEWTON_STEPS: usize = 25;
/// Largest change of the load in one Newton step, as a fraction of the load's range.
const MAX_CHANGE: f64 = 0.25;
/// Change of the load from which the last step is taken along the tangent, as a fraction of the load's range.
const TANGENT_FRACTION: f64 = 1e-5;

/// Values over the unknowns: load, then amplitudes.
pub(super) type Unknowns = [f64; UNKNOWNS];

/// A regime at one instant: what the next step is tested with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Instant {
    pub load: f64,
    pub amplitudes: Amplitudes,
    pub tangent: Coordinates,
    pub momenta: Unknowns,
    /// Rates of the last step, per second: where Newton's method begins.
    pub rates: Unknowns,
    /// Internal variables of the relaxation, by term.
    pub relaxing: [Unknowns; MAX_PRONY],
}

/// A step: regime, length in seconds, loads at rest at both ends.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step<'a> {
    pub regime: RegimeKind,
    pub prony: &'a [PronyTerm],
    pub h: f64,
    pub damping_s: f64,
    pub rest: [f64; 2],
}

/// Result of a step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stepped {
    pub instant: Instant,
    pub position: Coordinates,
    pub velocity: Coordinates,
}

/// Forces of a regime.
pub(super) struct Forces<'a> {
    pub modes: &'a [LinearMode],
    pub unit_load: &'a Coordinates,
    pub damping_s: f64,
}

impl Forces<'_> {
    /// Generalised forces at a load and amplitudes, tested with a tangent.
    pub fn at(
        &self,
        excess: f64,
        amplitudes: &Amplitudes,
        tangent: &Coordinates,
        velocity: &Coordinates,
    ) -> Unknowns {
        let mut forces = [0.0; UNKNOWNS];
        forces[0] = excess * dot(self.unit_load, tangent) - self.damping_s * dot(self.unit_load, velocity);
        for ((mode, y), force) in self.modes.iter().zip(amplitudes).zip(1..) {
            let (along, square) = (dot(self.unit_load, &mode.shape), mode.rate_rad_s * mode.rate_rad_s);
            forces[0] -= along * y;
            forces[force] = excess * along - square * (y + self.damping_s * dot(&mode.shape, velocity));
        }
        forces
    }

    /// Momenta of a velocity half a step ago, tested with a tangent at an instant.
    pub fn momenta(
        &self,
        h: f64,
        excess: f64,
        amplitudes: &Amplitudes,
        tangent: &Coordinates,
        velocity: &Coordinates,
    ) -> Unknowns {
        let forces = self.at(excess, amplitudes, tangent, velocity);
        let mut momenta = self.tested(tangent, velocity);
        momenta.iter_mut().zip(forces).for_each(|(p, force)| *p += 0.5 * h * force);
        momenta
    }

    /// `J' v`.
    pub fn tested(&self, tangent: &Coordinates, v: &Coordinates) -> Unknowns {
        let mut out = [0.0; UNKNOWNS];
        out[0] = dot(tangent, v);
        out[1..].iter_mut().zip(self.modes).for_each(|(p, mode)| *p = dot(&mode.shape, v));
        out
    }
}

/// One step from `now` at `position` to the inputs `next`. `None` if Newton's method does not converge.
pub(super) fn step(
    manifold: &mut impl Manifold,
    step: &Step<'_>,
    now: &Instant,
    position: &Coordinates,
    next: &Inputs,
) -> Option<Stepped> {
    let Step { regime, prony, h, damping_s, rest: [rest_now, rest_next] } = *step;
    let relaxation = Relaxing::new(prony, h, now);
    let rest = 0.5 * (rest_now + rest_next);
    let [low, high] = manifold.load_range();
    let (width, at) = (high - low, manifold.load_input());
    let mut load = now.load + h * now.rates[0];
    let mut amplitudes: Amplitudes = std::array::from_fn(|k| now.amplitudes[k] + h * now.rates[1 + k]);
    for _ in 0..NEWTON_STEPS {
        let place = manifold.place(regime, &next.with(at, load));
        let modes = manifold.modes(regime);
        let count = 1 + modes.len();
        let forces = Forces { modes, unit_load: manifold.unit_load(), damping_s };
        let mut reached = place.position;
        for (mode, y) in modes.iter().zip(&amplitudes) {
            reached.iter_mut().zip(&mode.shape).for_each(|(q, phi)| *q += phi * y);
        }
        let velocity = difference(&reached, position, h);
        let (mean, middle) = relaxation.means(load, &amplitudes);
        let excess = rest - mean;
        let acting = forces.at(excess, &middle, &now.tangent, &velocity);
        let carried = forces.tested(&now.tangent, &velocity);
        let mut right: Unknowns = std::array::from_fn(|i| now.momenta[i] + 0.5 * h * acting[i] - carried[i]);
        let mut matrix = jacobian(&forces, h, relaxation.stiffness, &now.tangent, &place.tangent);
        solve(&mut matrix, &mut right, count)?;
        let change = right[0].abs();
        let damp = if change > MAX_CHANGE * width { MAX_CHANGE * width / change } else { 1.0 };
        load += damp * right[0];
        amplitudes.iter_mut().zip(&right[1..count]).for_each(|(y, d)| *y += damp * d);
        if !load.is_finite() {
            return None;
        }
        if change <= TANGENT_FRACTION * width {
            // What is left is of second order in the change.
            let mut tail = place.tangent.map(|t| t * right[0]);
            for (mode, d) in modes.iter().zip(&right[1..]) {
                tail.iter_mut().zip(&mode.shape).for_each(|(q, phi)| *q += phi * d);
            }
            reached.iter_mut().zip(tail).for_each(|(q, d)| *q += d);
            let velocity = difference(&reached, position, h);
            let (mean, middle) = relaxation.means(load, &amplitudes);
            let momenta = forces.momenta(h, rest - mean, &middle, &place.tangent, &velocity);
            let mut rates = [(load - now.load) / h; UNKNOWNS];
            rates[1..]
                .iter_mut()
                .enumerate()
                .for_each(|(k, rate)| *rate = (amplitudes[k] - now.amplitudes[k]) / h);
            let relaxing = relaxed(prony, h, now, &rates);
            let instant = Instant { load, amplitudes, tangent: place.tangent, momenta, rates, relaxing };
            return Some(Stepped { instant, position: reached, velocity });
        }
    }
    None
}

/// Resistance of an elastomer within a step: `mean = constant + stiffness / 2 u` of the unknowns `u` at its end.
struct Relaxing {
    stiffness: f64,
    constant: Unknowns,
}

impl Relaxing {
    fn new(prony: &[PronyTerm], h: f64, now: &Instant) -> Self {
        let factors = prony.iter().map(|term| (term.ratio, term.within(h)));
        let stiffness = 1.0 + factors.clone().map(|(ratio, (_, a))| ratio * a).sum::<f64>();
        let mut constant = [0.5 * (2.0 - stiffness) * now.load; UNKNOWNS];
        constant[1..].iter_mut().zip(&now.amplitudes).for_each(|(c, y)| *c = 0.5 * (2.0 - stiffness) * y);
        for ((ratio, (e, _)), h) in factors.zip(&now.relaxing) {
            constant.iter_mut().zip(h).for_each(|(c, h)| *c += 0.5 * ratio * (1.0 + e) * h);
        }
        Self { stiffness, constant }
    }

    /// Means of load and amplitudes over the step.
    fn means(&self, load: f64, amplitudes: &Amplitudes) -> (f64, Amplitudes) {
        let mean = |at: usize, u: f64| self.constant[at] + 0.5 * self.stiffness * u;
        (mean(0, load), std::array::from_fn(|k| mean(1 + k, amplitudes[k])))
    }
}

/// Internal variables after a step with these rates.
fn relaxed(prony: &[PronyTerm], h: f64, now: &Instant, rates: &Unknowns) -> [Unknowns; MAX_PRONY] {
    let mut relaxing = now.relaxing;
    for (term, states) in prony.iter().zip(&mut relaxing) {
        let (e, a) = term.within(h);
        states.iter_mut().zip(rates).for_each(|(state, rate)| *state = e * *state + a * h * rate);
    }
    relaxing
}

fn difference(to: &Coordinates, from: &Coordinates, h: f64) -> Coordinates {
    std::array::from_fn(|i| (to[i] - from[i]) / h)
}

/// Derivative of the left minus the right side of the step with respect to the unknowns.
fn jacobian(
    forces: &Forces<'_>,
    h: f64,
    stiffness: f64,
    now: &Coordinates,
    next: &Coordinates,
) -> [Unknowns; UNKNOWNS] {
    let elastic = 0.25 * h * stiffness;
    let mut matrix = [[0.0; UNKNOWNS]; UNKNOWNS];
    let (modes, unit, beta) = (forces.modes, forces.unit_load, forces.damping_s);
    let row = |test: &Coordinates, damped: &Coordinates, factor: f64| {
        let with = |of: &Coordinates| dot(test, of) / h + 0.5 * beta * factor * dot(damped, of);
        let mut row = [0.0; UNKNOWNS];
        row[0] = with(next);
        row[1..].iter_mut().zip(modes).for_each(|(entry, mode)| *entry = with(&mode.shape));
        row
    };
    matrix[0] = row(now, unit, 1.0);
    matrix[0][0] += elastic * dot(unit, now);
    for (k, mode) in modes.iter().enumerate() {
        let (along, square) = (elastic * dot(unit, &mode.shape), mode.rate_rad_s * mode.rate_rad_s);
        matrix[0][1 + k] += along;
        matrix[1 + k] = row(&mode.shape, &mode.shape, square);
        matrix[1 + k][0] += along;
        matrix[1 + k][1 + k] += elastic * square;
    }
    matrix
}

/// Solves the leading `count` equations in place by Gaussian elimination with partial pivoting. `None` if a pivot is 0 or not a number.
pub(super) fn solve(matrix: &mut [Unknowns; UNKNOWNS], right: &mut Unknowns, count: usize) -> Option<()> {
    for k in 0..count {
        let largest = (k..count).max_by(|a, b| matrix[*a][k].abs().total_cmp(&matrix[*b][k].abs()))?;
        if !matrix[largest][k].is_normal() {
            return None;
        }
        matrix.swap(k, largest);
        right.swap(k, largest);
        for i in k + 1..count {
            let factor = matrix[i][k] / matrix[k][k];
            let pivot = matrix[k];
            matrix[i][k..count].iter_mut().zip(&pivot[k..count]).for_each(|(x, y)| *x -= factor * y);
            right[i] -= factor * right[k];
        }
    }
    for k in (0..count).rev() {
        right[k] /= matrix[k][k];
        for i in 0..k {
            right[i] -= matrix[i][k] * right[k];
        }
    }
    Some(())
}
