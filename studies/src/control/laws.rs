//! Laws that the controller is compared with.

use control::inverse::{Model, Quantity, inverse};
use control::law::{Cycle, Limited, Reading, Target};
use control::trial::Law;
use rom::memory::Line;

/// Proportional and integral action on the measured error, hand-tuned, with conditional integration.
pub struct Pi {
    /// MPa per unit of the error, and per unit and second.
    pub gains: [f64; 2],
    /// Range of the command, MPa.
    pub range_mpa: [f64; 2],
    /// Integral, MPa.
    pub sum_mpa: f64,
}

impl Law for Pi {
    fn update(&mut self, targets: &dyn Fn(f64) -> Target, reading: Reading, dt_s: f64) -> Cycle {
        let target = targets(0.0);
        let error = target.value - reading.measured;
        let [low, high] = self.range_mpa;
        let wanted_mpa = self.sum_mpa + self.gains[0] * error;
        if (low..=high).contains(&wanted_mpa) {
            self.sum_mpa += self.gains[1] * error * dt_s;
        }
        cycle(target, reading, wanted_mpa.clamp(low, high))
    }
}

/// The inverse model behind a reference of first order, the line inverted by direction, and a PI on the error as a pressure.
pub struct InversePi<M> {
    /// Model.
    pub model: M,
    /// Quantity that is followed.
    pub quantity: Quantity,
    /// Time constants of the line.
    pub line: Line,
    /// Time constant of the reference, s.
    pub reference_s: f64,
    /// Gains on the error as a pressure: 1, 1/s.
    pub gains: [f64; 2],
    /// Range of the command, MPa.
    pub range_mpa: [f64; 2],
    /// Reference and integral, MPa.
    pub state_mpa: [f64; 2],
}

impl<M: Model> Law for InversePi<M> {
    fn update(&mut self, targets: &dyn Fn(f64) -> Target, reading: Reading, dt_s: f64) -> Cycle {
        let target = targets(0.0);
        let start_mpa = self.state_mpa[0];
        let goal = inverse(&mut self.model, self.quantity, reading.gap_mm, target.value, start_mpa);
        let step_mpa = (goal.pressure_mpa - start_mpa) * (1.0 - (-dt_s / self.reference_s).exp());
        let reference_mpa = start_mpa + step_mpa;
        let found = inverse(&mut self.model, self.quantity, reading.gap_mm, reading.measured, reference_mpa);
        let error_mpa = reference_mpa - found.pressure_mpa;
        let time_s = if step_mpa >= 0.0 { self.line.fill_s } else { self.line.empty_s };
        let lead_mpa = if dt_s > 0.0 { time_s * step_mpa / dt_s } else { 0.0 };
        let wanted_mpa = reference_mpa + lead_mpa + self.gains[0] * error_mpa + self.state_mpa[1];
        let [low, high] = self.range_mpa;
        if (low..=high).contains(&wanted_mpa) {
            self.state_mpa[1] += self.gains[1] * error_mpa * dt_s;
        }
        self.state_mpa[0] = reference_mpa;
        cycle(target, reading, wanted_mpa.clamp(low, high))
    }
}

fn cycle(target: Target, reading: Reading, pressure_mpa: f64) -> Cycle {
    let limited = Limited::default();
    Cycle { pressure_mpa, target: target.value, followed: reading.measured, limited, ..Cycle::default() }
}
