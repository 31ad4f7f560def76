//! One step of the discrete equation of motion within a regime.
//!
//! Unknowns `u = (a_1, ..., y_1, ...)`, tangents `J = (X_1, ..., phi_1, ...)`, momenta `p = J' q'`. The step is that of the discrete
//! Lagrangian with forces at the mean of both ends,
//!
//! ```text
//! J_n'     (q_n+1 - q_n) / h = p_n  + h/2 Q(J_n)
//! p_n+1 = J_n+1' (q_n+1 - q_n) / h + h/2 Q(J_n+1)
//! Q(J) = J' K J (g - u) - beta J' K q',    K X_i = e_i,    K phi_k = w_k^2 phi_k
//! ```
//!
//! with `u` the mean, `g` the loads at rest (0 for amplitudes) and `q' = (q_n+1 - q_n) / h`. Second order; for a family that is linear
//! in the loads it is the trapezoidal rule: stable at any step, without energy error. No second derivatives of `X` and no rate of the
//! pressure are needed.
//!
//! A relaxing elastomer resists with `u + sum_k r_k h_k`, `h_k' = u' - h_k / tau_k`, in place of `u` (`memory/prony.rs`).

use super::manifold::{
    Amplitudes, Coordinates, Equilibrium, InertialLoad, LinearMode, MAX_LINEAR_MODES, MAX_LOADS, Manifold,
    Tangents, dot,
};
use crate::inputs::Inputs;
use crate::memory::{MAX_PRONY, PronyTerm};
use crate::snapshots::RegimeKind;

/// Unknowns of a step at most: loads and amplitudes.
pub(super) const UNKNOWNS: usize = MAX_LOADS + MAX_LINEAR_MODES;
/// Newton steps; two or three are usual.
const NEWTON_STEPS: usize = 25;
/// Largest change of a load in one Newton step, as a fraction of the load's range.
const MAX_CHANGE: f64 = 0.25;
/// Changes of the loads from which the last step is taken along the tangents, as fractions of the loads' ranges.
const TANGENT_FRACTION: f64 = 1e-5;

/// Factor on the diagonal of a least-squares problem over directions of motion: bounds the unknowns where two of them are alike.
const RIDGE: f64 = 1.0 + 1e-8;

/// Values over the unknowns: loads, then amplitudes; unused entries are 0.
pub(super) type Unknowns = [f64; UNKNOWNS];
/// Values over pairs of unknowns.
pub(super) type Matrix = [Unknowns; UNKNOWNS];

/// A regime at one instant: what the next step is tested with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Instant {
    pub at: Unknowns,
    pub tangents: Tangents,
    /// Unknowns by which the body comes nearest to the derivative of its position with respect to the pressure, per MPa.
    pub of_pressure: Unknowns,
    /// `J' K J`.
    pub elastic: Matrix,
    pub momenta: Unknowns,
    /// Rates of the last step, per second: where Newton's method begins.
    pub rates: Unknowns,
    /// Internal variables of the relaxation, by term.
    pub relaxing: [Unknowns; MAX_PRONY],
}

impl Instant {
    /// At rest under the loads of an equilibrium.
    pub fn at_rest(at: Unknowns, equilibrium: &Equilibrium, space: &Space<'_>) -> Self {
        let still = [0.0; UNKNOWNS];
        let (tangents, elastic) = (equilibrium.tangents, space.elastic());
        let of_pressure = space.nearest(&equilibrium.by_pressure);
        Self { at, tangents, of_pressure, elastic, momenta: still, rates: still, relaxing: [still; _] }
    }
}

/// Amplitudes of the linear modes behind `loads` loads.
pub(super) fn amplitudes(at: &Unknowns, loads: usize) -> Amplitudes {
    std::array::from_fn(|k| at[loads + k])
}

/// A step: regime, length in seconds, loads at rest at both ends.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step<'a> {
    pub regime: RegimeKind,
    pub prony: &'a [PronyTerm],
    pub h: f64,
    pub damping_s: f64,
    pub rest: [Unknowns; 2],
}

/// Result of a step.
#[derive(Clone, Copy, Debug)]
pub(super) struct StepEnd {
    pub instant: Instant,
    pub position: Coordinates,
    pub velocity: Coordinates,
}

/// Directions of motion at a place: tangents of the loads, then linear modes.
pub(super) struct Space<'a> {
    pub loads: &'a [InertialLoad],
    pub modes: &'a [LinearMode],
    pub tangents: &'a Tangents,
}

impl Space<'_> {
    /// Number of directions.
    pub fn count(&self) -> usize {
        self.loads.len() + self.modes.len()
    }

    /// Direction `J_i`.
    pub fn direction(&self, i: usize) -> &Coordinates {
        match i.checked_sub(self.loads.len()) {
            None => &self.tangents[i],
            Some(mode) => &self.modes[mode].shape,
        }
    }

    /// `K J_i`.
    fn resisted(&self, i: usize) -> Coordinates {
        match i.checked_sub(self.loads.len()) {
            None => self.loads[i].unit,
            Some(mode) => {
                let LinearMode { rate_rad_s, shape } = &self.modes[mode];
                shape.map(|phi| rate_rad_s * rate_rad_s * phi)
            }
        }
    }

    /// `J' v`.
    pub fn tested(&self, v: &Coordinates) -> Unknowns {
        self.each(|i| dot(self.direction(i), v))
    }

    /// Unknowns by which the body comes nearest to a displacement in the metric of the mass.
    pub fn nearest(&self, v: &Coordinates) -> Unknowns {
        let mut matrix = [[0.0; UNKNOWNS]; UNKNOWNS];
        for (i, row) in matrix.iter_mut().enumerate().take(self.count()) {
            *row = self.tested(self.direction(i));
            row[i] *= RIDGE;
        }
        let mut along = self.tested(v);
        solve(&mut matrix, &mut along, self.count()).map_or([0.0; _], |()| along)
    }

    /// `J' K J`.
    pub fn elastic(&self) -> Matrix {
        let loads = self.loads.len();
        let mut matrix = [[0.0; UNKNOWNS]; UNKNOWNS];
        for (i, row) in matrix.iter_mut().enumerate().take(self.count()) {
            for (j, entry) in row.iter_mut().enumerate().take(self.count()) {
                *entry = match (i < loads, j < loads) {
                    (_, true) => dot(&self.loads[j].unit, self.direction(i)),
                    (true, false) => dot(&self.loads[i].unit, self.direction(j)),
                    (false, false) if i == j => self.modes[i - loads].rate_rad_s.powi(2),
                    (false, false) => 0.0,
                };
            }
        }
        matrix
    }

    /// Momenta at the end of a step with this velocity; `excess` is `g - u` in its mean.
    pub fn momenta(
        &self,
        h: f64,
        damping_s: f64,
        elastic: &Matrix,
        excess: &Unknowns,
        velocity: &Coordinates,
    ) -> Unknowns {
        let damped = |i| damping_s * dot(&self.resisted(i), velocity);
        self.each(|i| {
            let force = times(&elastic[i], excess) - damped(i);
            dot(self.direction(i), velocity) + 0.5 * h * force
        })
    }

    fn each(&self, value: impl Fn(usize) -> f64) -> Unknowns {
        let count = self.count();
        std::array::from_fn(|i| if i < count { value(i) } else { 0.0 })
    }
}

/// `g` of inputs.
pub(super) fn rest(loads: &[InertialLoad], inputs: &Inputs) -> Unknowns {
    let mut rest = [0.0; UNKNOWNS];
    rest.iter_mut().zip(loads).for_each(|(rest, load)| *rest = inputs.values()[load.input]);
    rest
}

/// Inputs with the loads of unknowns.
pub(super) fn with_loads(loads: &[InertialLoad], inputs: &Inputs, at: &Unknowns) -> Inputs {
    loads.iter().zip(at).fold(*inputs, |inputs, (load, value)| inputs.with(load.input, *value))
}

/// One step from `now` at `position` to the inputs `next`. `None` if Newton's method does not converge.
pub(super) fn step(
    manifold: &mut impl Manifold,
    step: &Step<'_>,
    now: &Instant,
    position: &Coordinates,
    next: &Inputs,
) -> Option<StepEnd> {
    let Step { regime, prony, h, damping_s, .. } = *step;
    let relaxation = Relaxing::new(prony, h, now);
    let rest: Unknowns = std::array::from_fn(|i| 0.5 * (step.rest[0][i] + step.rest[1][i]));
    let excess = |at: &Unknowns| -> Unknowns { std::array::from_fn(|i| rest[i] - relaxation.mean(i, at[i])) };
    let equations = Equations::new(manifold, step, now, relaxation.stiffness);
    let mut coordinates: Unknowns = std::array::from_fn(|i| now.at[i] + h * now.rates[i]);
    for _ in 0..NEWTON_STEPS {
        let reached = with_loads(manifold.loads(), next, &coordinates);
        let equilibrium = manifold.equilibrium(regime, &reached);
        let space =
            Space { loads: manifold.loads(), modes: manifold.modes(regime), tangents: &equilibrium.tangents };
        let (loads, count) = (space.loads.len(), space.count());
        let mut moved: Coordinates = std::array::from_fn(|i| equilibrium.position[i] - position[i]);
        add(&mut moved, &space, loads..count, &coordinates);
        let excess_now = excess(&coordinates);
        let mut change = equations.right(now, &excess_now, &moved, count);
        let mut matrix = equations.matrix(&space);
        solve(&mut matrix, &mut change, count)?;
        let fraction = |(load, change): (&InertialLoad, &f64)| change.abs() / (load.range[1] - load.range[0]);
        let largest = space.loads.iter().zip(&change).map(fraction).fold(0.0, f64::max);
        let damp = if largest > MAX_CHANGE { MAX_CHANGE / largest } else { 1.0 };
        coordinates.iter_mut().zip(&change[..count]).for_each(|(u, d)| *u += damp * d);
        if !coordinates.iter().all(|u| u.is_finite()) {
            return None;
        }
        if largest <= TANGENT_FRACTION {
            // What is left is of second order in the change.
            add(&mut moved, &space, 0..count, &change);
            let velocity = moved.map(|d| d / h);
            let elastic = space.elastic();
            let momenta = space.momenta(h, damping_s, &elastic, &excess(&coordinates), &velocity);
            let rates: Unknowns = std::array::from_fn(|i| (coordinates[i] - now.at[i]) / h);
            let relaxing = relaxed(prony, h, now, &rates);
            let (tangents, of_pressure) = (equilibrium.tangents, space.nearest(&equilibrium.by_pressure));
            let instant =
                Instant { at: coordinates, tangents, of_pressure, elastic, momenta, rates, relaxing };
            let position = std::array::from_fn(|i| position[i] + moved[i]);
            return Some(StepEnd { instant, position, velocity });
        }
    }
    None
}

/// Adds directions times changes of the unknowns.
fn add(to: &mut Coordinates, space: &Space<'_>, unknowns: std::ops::Range<usize>, by: &Unknowns) {
    for i in unknowns {
        to.iter_mut().zip(space.direction(i)).for_each(|(q, along)| *q += along * by[i]);
    }
}

/// The equations of a step, `p_n + h/2 J_n' K J_n (g - u) = T d` of the way `d`, with `T = J_n / h + beta/2 K J_n`.
struct Equations {
    tests: [Coordinates; UNKNOWNS],
    half_s: f64,
    /// Derivative of the left side, negative, and that of the right side by the amplitudes, which do not change within a step.
    fixed: Matrix,
}

impl Equations {
    fn new(manifold: &impl Manifold, step: &Step<'_>, now: &Instant, stiffness: f64) -> Self {
        let Step { regime, h, damping_s, .. } = *step;
        let space = Space { loads: manifold.loads(), modes: manifold.modes(regime), tangents: &now.tangents };
        let (loads, count) = (space.loads.len(), space.count());
        let mut tests = [Coordinates::default(); UNKNOWNS];
        let mut fixed = now.elastic.map(|row| row.map(|entry| 0.25 * h * stiffness * entry));
        for (i, (test, row)) in tests.iter_mut().zip(&mut fixed).enumerate().take(count) {
            let (along, resisted) = (space.direction(i), space.resisted(i));
            *test = std::array::from_fn(|c| along[c] / h + 0.5 * damping_s * resisted[c]);
            for (entry, mode) in row[loads..].iter_mut().zip(space.modes) {
                *entry += dot(test, &mode.shape);
            }
        }
        Self { tests, half_s: 0.5 * h, fixed }
    }

    fn right(&self, now: &Instant, excess: &Unknowns, moved: &Coordinates, count: usize) -> Unknowns {
        let mut right = [0.0; UNKNOWNS];
        for (i, right) in right.iter_mut().enumerate().take(count) {
            let force = times(&now.elastic[i], excess);
            *right = now.momenta[i] + self.half_s * force - dot(&self.tests[i], moved);
        }
        right
    }

    fn matrix(&self, next: &Space<'_>) -> Matrix {
        let mut matrix = self.fixed;
        for (row, test) in matrix.iter_mut().zip(&self.tests).take(next.count()) {
            for (entry, tangent) in row.iter_mut().zip(next.tangents).take(next.loads.len()) {
                *entry += dot(test, tangent);
            }
        }
        matrix
    }
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
        let mut constant = now.at.map(|u| 0.5 * (2.0 - stiffness) * u);
        for ((ratio, (e, _)), h) in factors.zip(&now.relaxing) {
            constant.iter_mut().zip(h).for_each(|(c, h)| *c += 0.5 * ratio * (1.0 + e) * h);
        }
        Self { stiffness, constant }
    }

    /// Mean of an unknown over the step.
    fn mean(&self, i: usize, u: f64) -> f64 {
        self.constant[i] + 0.5 * self.stiffness * u
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

fn times(row: &Unknowns, by: &Unknowns) -> f64 {
    row.iter().zip(by).map(|(a, b)| a * b).sum()
}

/// Solves the leading `count` equations in place by Gaussian elimination with partial pivoting. `None` if a pivot is 0 or not a number.
pub(super) fn solve(matrix: &mut Matrix, right: &mut Unknowns, count: usize) -> Option<()> {
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
