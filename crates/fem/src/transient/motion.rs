//! State of motion, and its form in a checkpoint.

use super::relaxation::Relaxation;
use crate::algebra::Vec3;
use crate::config::MAX_CAVITIES;
use crate::state::State;

/// Energies since the start (mJ).
///
/// `external = kinetic + strain + damping + viscous + numerical`: the rest is the dissipation of the time integration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Energy {
    /// Work of pressure, gravity and a moving obstacle.
    pub external_mj: f64,
    /// Kinetic energy.
    pub kinetic_mj: f64,
    /// Strain energy of the long-term law and the sheet, with that of the contacts' penalties.
    pub strain_mj: f64,
    /// Work of the stiffness-proportional damping.
    pub damping_mj: f64,
    /// Work of the viscous part of the stress, stored and dissipated.
    pub viscous_mj: f64,
}

impl Energy {
    /// Difference to the external work (mJ).
    pub fn numerical_mj(&self) -> f64 {
        self.external_mj - self.kinetic_mj - self.strain_mj - self.damping_mj - self.viscous_mj
    }
}

/// Work spent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Steps taken.
    pub steps: usize,
    /// Steps that were too long, by their error or because the iteration failed, and were halved.
    pub rejected: usize,
    /// Steps of the least length with an error above the tolerance.
    pub beyond_tolerance: usize,
    /// Newton iterations, those of failed steps included.
    pub iterations: usize,
    /// Factorisations of the stiffness matrix.
    pub factorisations: usize,
}

/// Step lengths and their control.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepSettings {
    /// Largest step (s).
    pub largest_s: f64,
    /// Step (s) that is not shortened because of its error.
    pub smallest_s: f64,
    /// Largest estimated error of a step in displacement, mass-weighted root mean square (mm).
    pub tolerance_mm: f64,
}

impl Default for StepSettings {
    fn default() -> Self {
        Self { largest_s: 0.002, smallest_s: 0.000_125, tolerance_mm: 0.01 }
    }
}

/// Figures of an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Figures {
    /// y of the lowest point of the base's underside (mm).
    pub lowest_y_mm: f64,
    /// x of the tip (mm).
    pub tip_x_mm: f64,
    /// y of the tip (mm).
    pub tip_y_mm: f64,
    /// Force on the obstacle along y (N).
    pub contact_force_n: f64,
    /// Largest nodal von Mises stress, the viscous part included (MPa).
    pub max_stress_mpa: f64,
    /// z of the tip (mm).
    pub tip_z_mm: f64,
    /// Volume of the cavity minus that of the undeformed one (mm3).
    pub volume_mm3: f64,
    /// Energies since the start.
    pub energy: Energy,
}

/// Everything that the next step needs; vectors over the unknowns.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Motion {
    /// Time (s).
    pub(super) t_s: f64,
    /// Displacements, stress unknowns and loads.
    pub(super) state: State,
    /// Velocity (mm/s).
    pub(super) velocity: Vec<f64>,
    /// Acceleration (mm/s2).
    pub(super) acceleration: Vec<f64>,
    /// External minus internal forces (N), without damping.
    pub(super) force: Vec<f64>,
    /// Displacement of the last step (mm); in the first one that of the initial velocity.
    pub(super) increment: Vec<f64>,
    /// Its length (s).
    pub(super) step_s: f64,
    /// Force of the overstress (N); empty without a Prony series.
    pub(super) viscous: Vec<f64>,
    /// Internal variables of the Prony series.
    pub(super) relaxation: Option<Relaxation>,
    /// Volumes of the cavities (mm3), that of `pressure_mpa` first.
    pub(super) cavity_volumes_mm3: [f64; 1 + MAX_CAVITIES],
    /// Force on the obstacle (N).
    pub(super) contact_force_n: f64,
    /// Works since the start; kinetic and strain energy are those of the start.
    pub(super) energy: Energy,
    /// Halvings of the step.
    pub(super) level: u32,
    /// Work spent.
    pub(super) work: Work,
}

impl Motion {
    /// Numbers of a checkpoint.
    pub(super) fn values(&self) -> Vec<f64> {
        let mut values = Vec::new();
        // Every number has room in a vector.
        let _ = self.clone().visit(&mut |numbers| {
            values.extend_from_slice(numbers);
            Some(())
        });
        values
    }

    /// Sets the numbers of a checkpoint of the same problem; `None`, and an undefined motion, if their count differs.
    pub(super) fn restore(&mut self, values: &[f64]) -> Option<()> {
        let mut rest = values;
        self.visit(&mut |numbers| {
            let (head, tail) = rest.split_at_checked(numbers.len())?;
            numbers.copy_from_slice(head);
            rest = tail;
            Some(())
        })?;
        rest.is_empty().then_some(())
    }

    /// Calls `each` with all numbers, in the order of a checkpoint, until it returns `None`.
    fn visit(&mut self, each: &mut dyn FnMut(&mut [f64]) -> Option<()>) -> Option<()> {
        let Energy { external_mj, kinetic_mj, strain_mj, damping_mj, viscous_mj } = &mut self.energy;
        let energy = [external_mj, kinetic_mj, strain_mj, damping_mj, viscous_mj];
        for number in [&mut self.t_s, &mut self.step_s, &mut self.contact_force_n].into_iter().chain(energy) {
            each(std::slice::from_mut(number))?;
        }
        let Work { steps, rejected, beyond_tolerance, iterations, factorisations } = &mut self.work;
        let mut level = self.level as usize;
        for count in [&mut level, steps, rejected, beyond_tolerance, iterations, factorisations] {
            let mut number = *count as f64;
            each(std::slice::from_mut(&mut number))?;
            *count = number as usize;
        }
        self.level = level as u32;
        each(&mut self.cavity_volumes_mm3)?;
        each(self.state.displacement_mm.as_flattened_mut())?;
        each(&mut self.state.element_pressure_mpa)?;
        each(self.state.sheet_resultants_n_per_mm.as_flattened_mut().as_flattened_mut())?;
        let Self { velocity, acceleration, force, increment, viscous, .. } = self;
        for vector in [velocity, acceleration, force, increment, viscous] {
            each(vector)?;
        }
        if let Some(relaxation) = &mut self.relaxation {
            for tensors in relaxation.internal_mpa.iter_mut().chain([&mut relaxation.stress_mpa]) {
                each(tensors.as_flattened_mut().as_flattened_mut())?;
            }
        }
        Some(())
    }
}

/// Length of a displacement.
pub(super) fn largest(nodal: &[Vec3]) -> f64 {
    nodal.iter().map(|v| crate::algebra::norm(*v)).fold(0.0, f64::max)
}
