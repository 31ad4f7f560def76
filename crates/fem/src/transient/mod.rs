//! Motion in time: inertia, stiffness-proportional damping, viscoelasticity, contact.

mod motion;
mod record;
mod relaxation;
mod run;
mod step;
mod trace;

pub use motion::{Energy, Figures, StepSettings, Work};
pub use record::{Checkpoint, Record, energy_csv, run_mark, series_csv};
pub use run::{LongInterval, MotionError, MotionEvent, MotionOptions, MotionSummary, run_motion};
pub use trace::{Trace, TraceRow};

use crate::algebra::Vec3;
use crate::config::Load;
use crate::dynamics::Dynamics;
use crate::energy::{obstacle_n_mm, slots_n_mm, strain_n_mm};
use crate::linear::LinearError;
use crate::mass::{Mass, gather, product, scatter};
use crate::newton::{Newton, NewtonError};
use crate::output::{self, Output, clearance_mm, mean_von_mises};
use crate::problem::Problem;
use crate::solver::Solver;
use crate::state::State;
use crate::system::InvalidState;
use crate::vibration::VibrationError;
use motion::Motion;
use relaxation::Relaxation;
use rom::probe::tip_node;
use std::sync::Arc;
use thiserror::Error;

/// Error of a transient.
#[derive(Clone, Debug, Error, PartialEq)]
#[allow(missing_docs)] // the messages say what the values are
pub enum TransientError {
    /// The body has no mass.
    #[error("elastomer.density_t_per_mm3 = {0}, expected above 0: a motion needs a mass")]
    Density(f64),
    /// A step length or tolerance is out of range.
    #[error("{name} = {found}, expected {expected}")]
    Setting { name: &'static str, found: f64, expected: &'static str },
    /// The steps are too long for the actuator.
    #[error(
        "the lowest frequency at the start is {frequency_hz:.4} Hz: expected steps of at most {longest_s:.3e} s ({STEPS_PER_PERIOD} in a period), found {found_s} s; shorten the steps"
    )]
    Unresolved { frequency_hz: f64, longest_s: f64, found_s: f64 },
    /// No step length leads to an equilibrium of motion.
    #[error(
        "no equilibrium of motion after t = {t_s} s with steps down to {step_s:.1e} s: {reason}. Lower the pressure or its rate there"
    )]
    NotConverged { t_s: f64, step_s: f64, reason: NewtonError },
    /// The start is outside the limits of the elastomer.
    #[error("the start: {0}")]
    Start(NewtonError),
    /// The linear solver failed.
    #[error(transparent)]
    Linear(#[from] LinearError),
}

impl From<InvalidState> for TransientError {
    fn from(invalid: InvalidState) -> Self {
        Self::Start(invalid.into())
    }
}

/// Steps in a period of the lowest frequency, at least.
const STEPS_PER_PERIOD: f64 = 10.0;

/// Checks that step lengths and tolerance are in range.
///
/// # Errors
/// [`TransientError::Setting`].
fn check(settings: &StepSettings) -> Result<(), TransientError> {
    let wrong = |name, found, expected| Err(TransientError::Setting { name, found, expected });
    if !(1.0e-6..=0.1).contains(&settings.largest_s) {
        return wrong("largest step", settings.largest_s, "1e-6 to 0.1 s");
    }
    if !(1.0e-8..=settings.largest_s).contains(&settings.smallest_s) {
        return wrong("smallest step", settings.smallest_s, "1e-8 s to the largest step");
    }
    if !(settings.tolerance_mm > 0.0 && settings.tolerance_mm.is_finite()) {
        return wrong("step error", settings.tolerance_mm, "a finite length above 0 mm");
    }
    Ok(())
}

/// Smallest parts of an interval.
const PARTS: u32 = 12;
/// Halvings below the smallest step because the iteration fails.
const FAILURES: f64 = 16.0;
/// Part of the tolerance below which the next step is twice as long.
const EASY: f64 = 0.1;

/// Motion of a body from a start on.
pub struct Transient {
    problem: Arc<Problem>,
    newton: Newton,
    mass: Mass,
    dynamics: Dynamics,
    settings: StepSettings,
    motion: Motion,
    tip: usize,
    /// True if there is a factor of an earlier iterate.
    has_factor: bool,
}

impl Transient {
    /// Motion that starts at rest in the static equilibrium `state` at time `t_s`, relaxed.
    pub fn from_equilibrium(
        problem: Arc<Problem>,
        dynamics: &Dynamics,
        settings: StepSettings,
        t_s: f64,
        state: State,
    ) -> Result<Self, TransientError> {
        check(&settings)?;
        if let Some(bad) = problem.config.elastomers.iter().find(|e| e.density_t_per_mm3 <= 0.0) {
            return Err(TransientError::Density(bad.density_t_per_mm3));
        }
        let mut newton = Newton::new(Arc::clone(&problem))?;
        let relaxation = Relaxation::relaxed(&problem, dynamics, &state.displacement_mm)?;
        newton.system.assemble(&problem, &state, &state.load, crate::system::Ahead::default(), false)?;
        let zero = vec![0.0; problem.pattern.unknowns()];
        let u = &state.displacement_mm;
        let strain_mj = stored_mj(&problem, u, &state.load)?;
        let motion = Motion {
            t_s,
            velocity: zero.clone(),
            acceleration: zero.clone(),
            increment: zero.clone(),
            step_s: settings.largest_s,
            force: gather(&problem, &newton.system.mixed),
            viscous: if relaxation.is_some() { zero } else { Vec::new() },
            relaxation,
            cavity_volumes_mm3: newton.system.cavity_volumes_mm3,
            contact_force_n: newton.system.contact_force_n,
            energy: Energy { strain_mj, ..Energy::default() },
            level: 0,
            work: Work::default(),
            state,
        };
        let (mass, tip) = (Mass::new(&problem), tip_node(&problem.mesh.nodes_mm).unwrap_or(0));
        let dynamics = dynamics.clone();
        Ok(Self { newton, mass, dynamics, settings, motion, tip, has_factor: false, problem })
    }

    /// Motion that starts from `state` with nodal velocities (mm/s), out of equilibrium.
    pub fn released(
        problem: Arc<Problem>,
        dynamics: &Dynamics,
        settings: StepSettings,
        state: State,
        velocity_mm_s: &[Vec3],
    ) -> Result<Self, TransientError> {
        let mut this = Self::from_equilibrium(problem, dynamics, settings, 0.0, state)?;
        let problem = Arc::clone(&this.problem);
        this.motion.velocity = gather(&problem, velocity_mm_s);
        let step_s = this.motion.step_s;
        this.motion.increment = this.motion.velocity.iter().map(|v| step_s * v).collect();
        this.motion.energy.kinetic_mj = 0.5 * square(&this.mass, &problem, &this.motion.velocity);
        this.newton.system.tangent.copy_from_slice(&this.mass.values);
        this.newton.system.turning.clear();
        this.newton.tangent.factorise(&problem, &this.newton.system)?;
        this.motion.acceleration.clone_from(&this.motion.force);
        this.newton.tangent.solve(&mut this.motion.acceleration);
        Ok(this)
    }

    /// Time reached (s).
    pub fn t_s(&self) -> f64 {
        self.motion.t_s
    }

    /// Work spent.
    pub fn work(&self) -> Work {
        self.motion.work
    }

    /// Displacements (mm) and loads.
    pub fn state(&self) -> &State {
        &self.motion.state
    }

    /// Nodal velocities (mm/s).
    pub fn velocity_mm_s(&self) -> Vec<[f64; 3]> {
        scatter(&self.problem, &self.motion.velocity)
    }

    /// Lowest frequency (Hz) of small motions about the present state; `None` if it is not stable.
    fn lowest_frequency_hz(&self) -> Result<Option<f64>, TransientError> {
        let mut solver = Solver::new(Arc::clone(&self.problem))?;
        match solver.vibrations(&self.motion.state, 1) {
            Ok(found) => Ok(found.first().map(|vibration| vibration.rate_rad_s / std::f64::consts::TAU)),
            Err(VibrationError::State(reason)) => Err(TransientError::Start(reason)),
            Err(VibrationError::Linear(error)) => Err(error.into()),
            Err(VibrationError::Unstable { .. } | VibrationError::None) => Ok(None),
        }
    }

    /// Checks that the largest step resolves the lowest frequency, and returns it (Hz).
    ///
    /// # Errors
    /// [`TransientError::Unresolved`].
    pub fn check_resolution(&self) -> Result<Option<f64>, TransientError> {
        let found_s = self.settings.largest_s;
        let frequency_hz = self.lowest_frequency_hz()?;
        match frequency_hz {
            Some(frequency_hz) if frequency_hz * found_s * STEPS_PER_PERIOD > 1.0 => {
                let longest_s = 1.0 / (STEPS_PER_PERIOD * frequency_hz);
                Err(TransientError::Unresolved { frequency_hz, longest_s, found_s })
            }
            _ => Ok(frequency_hz),
        }
    }

    /// Moves on to `until_s` under the loads of each time, in steps that divide the way by powers of two and are not longer than
    /// the largest.
    ///
    /// # Errors
    /// [`TransientError::NotConverged`]; the motion is then that of the time reached.
    pub fn advance(&mut self, load_at: &dyn Fn(f64) -> Load, until_s: f64) -> Result<(), TransientError> {
        let (from_s, units) = (self.motion.t_s, 1_u32 << PARTS);
        let parts = ((until_s - from_s) / self.settings.largest_s * (1.0 - 1.0e-9)).ceil().max(1.0);
        let part_s = (until_s - from_s) / parts;
        for part in 0..parts as u64 {
            let mut done = 0_u32;
            while done < units {
                // A long step begins at a multiple of its length.
                let aligned = PARTS - done.trailing_zeros().min(PARTS);
                let level = self.motion.level.max(aligned);
                let length = units >> level;
                let h = part_s * f64::from(length) / f64::from(units);
                let end = part as f64 + f64::from(done + length) / f64::from(units);
                let end_s = if end == parts { until_s } else { from_s + part_s * end };
                done += self.step(level, h, end_s, &load_at(end_s))? * length;
            }
        }
        Ok(())
    }

    /// Tries a step; 1 if it was taken, 0 if the next one is shorter.
    fn step(&mut self, level: u32, h: f64, end_s: f64, load: &Load) -> Result<u32, TransientError> {
        let StepSettings { smallest_s, tolerance_mm, .. } = self.settings;
        match self.attempt(h, load) {
            Ok(trial) if trial.error_mm <= tolerance_mm || 0.5 * h < smallest_s => {
                self.motion = Motion { t_s: end_s, level, work: self.motion.work, ..trial.motion };
                self.motion.work.steps += 1;
                self.motion.work.beyond_tolerance += usize::from(trial.error_mm > tolerance_mm);
                if trial.error_mm < EASY * tolerance_mm {
                    self.motion.level = level.saturating_sub(1);
                }
                tracing::debug!(t_s = end_s, h, error_mm = trial.error_mm, "step");
                return Ok(1);
            }
            Err(reason) if level == PARTS || 0.5 * h < smallest_s / FAILURES => {
                return Err(TransientError::NotConverged { t_s: self.motion.t_s, step_s: h, reason });
            }
            Err(reason) => tracing::debug!(t_s = end_s, h, %reason, "step halved"),
            Ok(trial) => tracing::debug!(t_s = end_s, h, error_mm = trial.error_mm, "step halved"),
        }
        self.motion.work.rejected += 1;
        self.motion.level = level + 1;
        Ok(0)
    }

    /// Figures of the present instant.
    ///
    /// # Errors
    /// [`TransientError::Start`], of a state outside the limits of the elastomer.
    pub fn figures(&self) -> Result<Figures, TransientError> {
        let (problem, motion) = (&self.problem, &self.motion);
        let u = &motion.state.displacement_mm;
        let tip = crate::algebra::add(problem.mesh.nodes_mm[self.tip], u[self.tip]);
        let energy = Energy {
            kinetic_mj: 0.5 * square(&self.mass, problem, &motion.velocity) - motion.energy.kinetic_mj,
            strain_mj: stored_mj(problem, u, &motion.state.load)? - motion.energy.strain_mj,
            ..motion.energy
        };
        Ok(Figures {
            lowest_y_mm: -clearance_mm(problem, &motion.state),
            tip_x_mm: tip[0],
            tip_y_mm: tip[1],
            contact_force_n: motion.contact_force_n,
            max_stress_mpa: self.von_mises_mpa().into_iter().fold(0.0, f64::max),
            tip_z_mm: tip[2],
            volume_mm3: motion.cavity_volumes_mm3[0] - problem.undeformed_volume_mm3(),
            energy,
        })
    }

    fn von_mises_mpa(&self) -> Vec<f64> {
        let over = self.motion.relaxation.as_ref().map(Relaxation::overstress_mpa);
        mean_von_mises(&self.problem, &self.motion.state.displacement_mm, over.as_deref()).0
    }

    /// Fields of the present instant; the force out of balance is the inertial one.
    pub fn output(&mut self) -> Output {
        let von_mises_mpa = self.von_mises_mpa();
        self.newton.system.overstress = None;
        let output = output::output(&self.problem, &self.motion.state, &mut self.newton.system);
        Output { von_mises_mpa, ..output }
    }

    /// Numbers from which [`Transient::restore`] continues with the same result as this one.
    pub fn checkpoint(&mut self) -> Vec<f64> {
        // The factor is not stored.
        self.has_factor = false;
        self.motion.values()
    }

    /// Continues from a checkpoint of the same problem and settings, at the loads of its time; false, and an undefined motion, if it
    /// has another number of values.
    pub fn restore(&mut self, values: &[f64], load_at: &dyn Fn(f64) -> Load) -> bool {
        self.has_factor = false;
        let restored = self.motion.restore(values).is_some();
        self.motion.state.load = load_at(self.motion.t_s);
        restored
    }
}

/// `v . M v`.
fn square(mass: &Mass, problem: &Problem, v: &[f64]) -> f64 {
    product(v, &mass.times(problem, v))
}

/// Strain energy and energy of the contacts (mJ).
fn stored_mj(problem: &Problem, u: &[Vec3], load: &Load) -> Result<f64, InvalidState> {
    Ok(strain_n_mm(problem, u)? + obstacle_n_mm(problem, u, load.obstacle) + slots_n_mm(problem, u))
}
