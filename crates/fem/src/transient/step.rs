//! One implicit step: Hilber, Hughes and Taylor's form of Newmark's method.
//!
//! `M a_1 = (1 + alpha) f_1 - alpha f_0 + beta / h (b_1 - b(x_0))`, with the force `f` of stresses, loads and contacts, and its
//! part `b` without contacts, `b(x_0)` at the loads of the step's end: the damping of a rotation is zero.

use super::Transient;
use super::motion::{Motion, largest};
use crate::algebra::{Vec3, add, axpy, dot, norm, scale, sub};
use crate::config::{Load, pressures_mpa};
use crate::linear::CONSTRAINED;
use crate::mass::{gather, product, scatter};
use crate::newton::{NewtonError, TURNING_WITHIN_MM};
use crate::output::MAX_RESIDUAL;
use std::sync::Arc;

/// Numerical dissipation: 0 for none, -1/3 for the most. Second order in the step; the ratio of damping to critical damping at a
/// frequency with `omega h = 0.05` (4 Hz at 2 ms) is 6e-5.
const ALPHA: f64 = -0.05;
/// Newmark's constants that make the method stable and of second order.
const BETA: f64 = (1.0 - ALPHA) * (1.0 - ALPHA) / 4.0;
const GAMMA: f64 = 0.5 - ALPHA;

/// Iterations of a step.
const MAX_ITERATIONS: usize = 20;
/// Relative residual of the linear equation when it is solved with an older factor: at 1e-3, which the stiff directions alone
/// reach, the soft ones are wrong by a whole correction.
const LINEAR_TOLERANCE: f64 = 1.0e-5;
/// Reference force of a body without reactions (N).
const MIN_REACTION_N: f64 = 1.0e-3;

/// End of a step.
pub(super) struct Trial {
    /// Motion at its end.
    pub(super) motion: Motion,
    /// Estimated local error of the displacement, mass-weighted root mean square (mm).
    pub(super) error_mm: f64,
}

/// Terms that are constant within a step.
struct Step<'a> {
    h: f64,
    load: &'a Load,
    /// Displacements of zero acceleration at the end (mm).
    coast: Vec<f64>,
    /// Force at the start, without contacts, at the loads of the end (N).
    reference: Vec<Vec3>,
}

/// Forces out of balance.
struct Imbalance {
    /// With stresses that follow from the displacements; over the unknowns (N).
    condensed: Vec<f64>,
    /// Largest nodal force with the carried stresses, relative to reaction and obstacle force.
    relative: f64,
    acceleration: Vec<f64>,
}

impl Transient {
    /// One step of length `h` to `load`; the motion is untouched. The iteration starts with the increment of the last
    /// step, or without one if that fails.
    pub(super) fn attempt(&mut self, h: f64, load: &Load) -> Result<Trial, NewtonError> {
        self.iterate(h, load, true).or_else(|_| {
            self.has_factor = false;
            self.iterate(h, load, false)
        })
    }

    fn iterate(&mut self, h: f64, load: &Load, ahead: bool) -> Result<Trial, NewtonError> {
        let problem = Arc::clone(&self.problem);
        let from = &self.motion;
        self.newton.system.overstress = from.relaxation.as_ref().map(|relaxation| relaxation.within(h));
        let x = problem.positions(&from.state.displacement_mm);
        self.newton.system.assemble_body(&problem, &from.state, &x, load, 0.0, false)?;
        let u = gather(&problem, &from.state.displacement_mm);
        let coasting = u.iter().zip(&from.velocity).zip(&from.acceleration);
        let step = Step {
            h,
            load,
            coast: coasting.map(|((u, v), a)| u + h * v + h * h * (0.5 - BETA) * a).collect(),
            reference: self.newton.system.mixed.clone(),
        };
        let mut state = from.state.clone();
        state.load = *load;
        if ahead {
            // The last increment, and not velocity and acceleration: those of light walls alternate from step to step.
            let moved: Vec<f64> = from.increment.iter().map(|du| h / from.step_s * du).collect();
            self.newton.displace(&mut state, scatter(&problem, &moved));
        }

        let settings = problem.config.newton;
        let (mut last_mm, mut next_mm) = (f64::INFINITY, f64::INFINITY);
        for iteration in 0..MAX_ITERATIONS {
            let is_last = next_mm < settings.correction_tolerance_mm;
            let mut imbalance = self.assemble(&state, &step, !is_last)?;
            if is_last {
                if imbalance.relative <= MAX_RESIDUAL {
                    return self.finish(state, &step, imbalance.acceleration);
                }
                imbalance = self.assemble(&state, &step, true)?;
            }
            if last_mm > TURNING_WITHIN_MM {
                self.newton.system.turning.clear();
            }
            let correction = scatter(&problem, &self.solve(imbalance.condensed, h)?);
            let correction_mm = largest(&correction);
            self.motion.work.iterations += 1;
            tracing::debug!(correction_mm, residual = imbalance.relative, "iteration");
            if correction_mm.is_nan() || correction_mm > settings.displacement_cap_mm {
                return Err(NewtonError::Stalled { iterations: iteration + 1, correction_mm });
            }
            self.newton.displace(&mut state, correction);
            let ratio = if last_mm.is_finite() { (correction_mm / last_mm).min(1.0) } else { 1.0 };
            next_mm = correction_mm * ratio;
            last_mm = correction_mm;
        }
        Err(NewtonError::Stalled { iterations: MAX_ITERATIONS, correction_mm: last_mm })
    }

    /// Solves with the assembled tangent and the mass of a step.
    fn solve(&mut self, mut side: Vec<f64>, h: f64) -> Result<Vec<f64>, NewtonError> {
        let (newton, inertia) = (&mut self.newton, 1.0 / (BETA * h * h));
        newton.system.tangent.iter_mut().zip(&self.mass.values).for_each(|(k, m)| *k += inertia * m);
        let tolerance = std::mem::take(&mut self.has_factor).then_some(LINEAR_TOLERANCE);
        let factorised =
            newton.tangent.solve_assembled(&self.problem, &newton.system, &mut side, tolerance)?;
        self.has_factor = true;
        self.motion.work.factorisations += usize::from(factorised);
        Ok(side)
    }

    /// Assembles forces, and the tangent without mass, of an iterate.
    fn assemble(
        &mut self,
        state: &crate::state::State,
        step: &Step<'_>,
        with_tangent: bool,
    ) -> Result<Imbalance, NewtonError> {
        let (problem, system) = (&self.problem, &mut self.newton.system);
        let damping = self.dynamics.beta_s / step.h;
        let x = problem.positions(&state.displacement_mm);
        system.assemble_body(problem, state, &x, step.load, 0.0, with_tangent)?;
        if with_tangent {
            system.tangent.iter_mut().for_each(|k| *k *= 1.0 + ALPHA + damping);
        }
        let weight = with_tangent.then_some(1.0 + ALPHA);
        system.assemble_contact(problem, step.load.obstacle, 0.0, &x, weight);
        let u = gather(problem, &state.displacement_mm);
        let acceleration: Vec<f64> =
            u.iter().zip(&step.coast).map(|(u, c)| (u - c) / (BETA * step.h * step.h)).collect();
        let inertia = self.mass.times(problem, &acceleration);
        let (inertia, before) = (scatter(problem, &inertia), scatter(problem, &self.motion.force));
        let (mut largest_n, mut reaction) = (0.0_f64, [0.0; 3]);
        let mut condensed = vec![[0.0; 3]; x.len()];
        for (n, out) in condensed.iter_mut().enumerate() {
            let (contact, reference) = (system.contact[n], step.reference[n]);
            if problem.free[n] == CONSTRAINED {
                axpy(1.0, add(system.mixed[n], contact), &mut reaction);
                continue;
            }
            let balance = |body: Vec3| {
                let mut r = scale(1.0 + ALPHA, add(body, contact));
                axpy(-ALPHA, before[n], &mut r);
                axpy(damping, sub(body, reference), &mut r);
                sub(r, inertia[n])
            };
            largest_n = largest_n.max(norm(balance(system.mixed[n])));
            *out = balance(system.condensed[n]);
        }
        let reference_n = norm(reaction).max(system.contact_force_n).max(MIN_REACTION_N);
        let condensed = gather(problem, &condensed);
        Ok(Imbalance { condensed, relative: largest_n / reference_n, acceleration })
    }

    /// The motion at the end of a step that has converged to `state`, whose forces are assembled.
    fn finish(
        &mut self,
        state: crate::state::State,
        step: &Step<'_>,
        acceleration: Vec<f64>,
    ) -> Result<Trial, NewtonError> {
        let (problem, from, h) = (Arc::clone(&self.problem), &self.motion, step.h);
        let system = &mut self.newton.system;
        let total = |(body, contact): (&Vec3, &Vec3)| add(*body, *contact);
        let force: Vec<Vec3> = system.mixed.iter().zip(&system.contact).map(total).collect();
        let moved = state.displacement_mm.iter().zip(&from.state.displacement_mm);
        let moved: Vec<Vec3> = moved.map(|(a, b)| sub(*a, *b)).collect();
        let mut energy = from.energy;
        for ((now, then), du) in system.mixed.iter().zip(&step.reference).zip(&moved) {
            energy.damping_mj -= self.dynamics.beta_s / h * dot(sub(*now, *then), *du);
        }
        let (was, is) = (from.state.load, *step.load);
        let mpa = [was, is].map(|load| pressures_mpa(&problem.config, &load));
        for (k, volume_mm3) in system.cavity_volumes_mm3.iter().enumerate() {
            energy.external_mj += 0.5 * (mpa[0][k] + mpa[1][k]) * (volume_mm3 - from.cavity_volumes_mm3[k]);
        }
        let gravity = scale(0.5, add(was.gravity_mm_s2, is.gravity_mm_s2));
        energy.external_mj +=
            moved.iter().zip(&problem.node_mass_t).map(|(du, m)| m * dot(gravity, *du)).sum::<f64>();
        let contact_force_n = system.contact_force_n;
        if let (Some(was), Some(is)) = (was.obstacle.gap_mm(), is.obstacle.gap_mm()) {
            energy.external_mj += 0.5 * (from.contact_force_n + contact_force_n) * (was - is);
        }
        let cavity_volumes_mm3 = system.cavity_volumes_mm3;
        let force = gather(&problem, &force);
        let mut viscous = Vec::new();
        let mut relaxation = None;
        if let Some(before) = &from.relaxation {
            let whole = gather(&problem, &system.mixed);
            let x = problem.positions(&state.displacement_mm);
            system.overstress = None;
            system.assemble_body(&problem, &state, &x, step.load, 0.0, false)?;
            let elastic = gather(&problem, &system.mixed);
            viscous = whole.iter().zip(&elastic).map(|(whole, elastic)| whole - elastic).collect();
            let both: Vec<f64> = viscous.iter().zip(&from.viscous).map(|(a, b)| a + b).collect();
            energy.viscous_mj -= 0.5 * product(&both, &gather(&problem, &moved));
            relaxation = Some(before.after(&problem, h, &state.displacement_mm)?);
        }
        let rates = from.velocity.iter().zip(&from.acceleration).zip(&acceleration);
        let velocity = rates.map(|((v, a0), a1)| v + h * ((1.0 - GAMMA) * a0 + GAMMA * a1)).collect();
        let change: Vec<f64> = acceleration.iter().zip(&from.acceleration).map(|(a1, a0)| a1 - a0).collect();
        let total_t: f64 = problem.node_mass_t.iter().sum();
        let square = product(&change, &self.mass.times(&problem, &change)).max(0.0) / total_t;
        let motion = Motion {
            t_s: from.t_s + h,
            state,
            velocity,
            acceleration,
            force,
            increment: gather(&problem, &moved),
            step_s: h,
            viscous,
            relaxation,
            cavity_volumes_mm3,
            contact_force_n,
            energy,
            level: from.level,
            work: from.work,
        };
        // Difference to the displacement of an acceleration that is linear in time (Zienkiewicz and Xie 1991).
        Ok(Trial { motion, error_mm: (BETA - 1.0 / 6.0) * h * h * square.sqrt() })
    }
}
