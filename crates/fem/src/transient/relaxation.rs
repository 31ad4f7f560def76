//! Viscoelasticity of the elastomer: a Prony series on the deviatoric stress at finite strain.
//!
//! `S0 = 2 W' (1 - tr C / 3 C^-1)` is the isochoric second Piola stress of the long-term law times `J^(2/3)`. Each term has a
//! stress with `H' = S0' - H / tau`, and the body the stress `S = J^(-2/3) DEV(S0 + sum r H) + p J C^-1` with
//! `r = w / (1 - sum w)` (Simo 1987). `S0` is linear in time within a step, `H_1 = e H_0 + a (S0_1 - S0_0)` with `e = exp(-h / tau)` and
//! `a = (1 - e) tau / h`. The stress at the end of the step is then that of a stiffer law and of a given stress.

use crate::algebra::Vec3;
use crate::dynamics::Dynamics;
use crate::element::tet10::{PointTensors, isochoric_stress};
use crate::problem::Problem;
use crate::system::{InvalidState, Overstress};

/// Internal variables of all elements.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Relaxation {
    /// Ratio `r` and time (s) of each term.
    terms: Vec<(f64, f64)>,
    /// `H` of each term and element (MPa).
    pub(super) internal_mpa: Vec<Vec<PointTensors>>,
    /// `S0` of each element (MPa).
    pub(super) stress_mpa: Vec<PointTensors>,
}

/// `e` and `a` of a term for a step.
fn decay(time_s: f64, step_s: f64) -> (f64, f64) {
    let lost = -(-step_s / time_s).exp_m1();
    (1.0 - lost, lost * time_s / step_s)
}

fn stresses(problem: &Problem, u: &[Vec3]) -> Result<Vec<PointTensors>, InvalidState> {
    let stress = |(e, tet): (usize, &[u32; 10])| {
        let u = tet.map(|n| u[n as usize]);
        isochoric_stress(&problem.tets[e], &u, &problem.elastomer(e).law)
            .map_err(|reason| InvalidState { reason, element: e })
    };
    problem.mesh.tets.iter().enumerate().map(stress).collect()
}

/// `sum += factor tensors`.
fn add(factor: f64, tensors: &[PointTensors], sum: &mut [PointTensors]) {
    let pairs =
        sum.as_flattened_mut().as_flattened_mut().iter_mut().zip(tensors.as_flattened().as_flattened());
    pairs.for_each(|(sum, value)| *sum += factor * value);
}

impl Relaxation {
    /// Relaxed body at displacements `u`; `None` without a series.
    pub(super) fn relaxed(
        problem: &Problem,
        dynamics: &Dynamics,
        u: &[Vec3],
    ) -> Result<Option<Self>, InvalidState> {
        let terms = dynamics.ratios();
        if terms.is_empty() {
            return Ok(None);
        }
        let zero = vec![[[0.0; 6]; 4]; problem.mesh.tets.len()];
        Ok(Some(Self { internal_mpa: vec![zero; terms.len()], stress_mpa: stresses(problem, u)?, terms }))
    }

    /// The viscous part within a step of this length.
    pub(super) fn within(&self, step_s: f64) -> Overstress {
        let mut over = Overstress { factor: 1.0, stress_mpa: vec![[[0.0; 6]; 4]; self.stress_mpa.len()] };
        for ((ratio, time_s), internal) in self.terms.iter().zip(&self.internal_mpa) {
            let (e, a) = decay(*time_s, step_s);
            over.factor += ratio * a;
            add(ratio * e, internal, &mut over.stress_mpa);
            add(-ratio * a, &self.stress_mpa, &mut over.stress_mpa);
        }
        over
    }

    /// The internal variables after a step to displacements `u`.
    pub(super) fn after(&self, problem: &Problem, step_s: f64, u: &[Vec3]) -> Result<Self, InvalidState> {
        let stress_mpa = stresses(problem, u)?;
        let mut after = self.clone();
        for ((_, time_s), internal) in self.terms.iter().zip(&mut after.internal_mpa) {
            let (e, a) = decay(*time_s, step_s);
            internal.as_flattened_mut().as_flattened_mut().iter_mut().for_each(|h| *h *= e);
            add(a, &stress_mpa, internal);
            add(-a, &self.stress_mpa, internal);
        }
        after.stress_mpa = stress_mpa;
        Ok(after)
    }

    /// `sum r H` of each element (MPa).
    pub(super) fn overstress_mpa(&self) -> Vec<PointTensors> {
        let mut sum = vec![[[0.0; 6]; 4]; self.stress_mpa.len()];
        for ((ratio, _), internal) in self.terms.iter().zip(&self.internal_mpa) {
            add(*ratio, internal, &mut sum);
        }
        sum
    }
}
