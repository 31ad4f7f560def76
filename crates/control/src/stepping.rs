//! The controller in a loop that is not ours: made of a model and a scene's file, stepped by readings with their times, without a bus.

use crate::held::{Description, Held, HeldError};
use crate::law::{Controller, Cycle, Reading, Target};
use crate::twin_model::TwinModel;
use rom::model::Model;

/// A controller with the time of its last reading.
#[derive(Debug)]
pub struct Stepping {
    controller: Controller<TwinModel>,
    last_ns: Option<u64>,
}

/// Why a reading was refused; nothing has changed, and the setpoint before expires.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum StepError {
    /// A time that is not later.
    #[error("expected a time later than the last reading's, {last_ns} ns, found {found_ns} ns")]
    NotLater { last_ns: u64, found_ns: u64 },
    /// A value that has to be a number.
    #[error("{name}: expected a number, found {found}")]
    NotFinite { name: &'static str, found: f64 },
}

impl Stepping {
    /// A controller of what `column` names (`force_n`, `tip_y_mm`, `pressure_mpa`, `angle_deg`, an observable of the model). Of the scene's text it
    /// takes `control`, the driven valve, `sigma.force_n`, markers and given inputs of the actuator (default: the first one); without a scene the defaults hold.
    pub fn open(
        model: &Model,
        scene: Option<&str>,
        actuator: Option<&str>,
        column: &str,
    ) -> Result<Self, HeldError> {
        let of = scene.map(|text| Description::read(text, actuator)).transpose()?.unwrap_or_default();
        let held = Held::new(&of, model.clone(), column)?;
        let controller = Controller::new(held.model()?, held.quantity, held.settings, held.limits);
        Ok(Self { controller, last_ns: None })
    }

    /// One control cycle at `t_ns`, later than the last one. The target moves on by its rate. Never allocates with the first law. A `measured` or `written_mpa` that is NaN is absent.
    ///
    /// # Errors
    /// [`StepError`]: nothing has changed.
    pub fn step(&mut self, t_ns: u64, target: Target, reading: Reading) -> Result<Cycle, StepError> {
        for (name, found) in [
            ("pressure_mpa", reading.pressure_mpa),
            ("gap_mm", reading.gap_mm),
            ("target", target.value),
            ("rate", target.rate),
        ] {
            if !found.is_finite() {
                return Err(StepError::NotFinite { name, found });
            }
        }
        if let Some(last_ns) = self.last_ns.filter(|last_ns| t_ns <= *last_ns) {
            return Err(StepError::NotLater { last_ns, found_ns: t_ns });
        }
        let elapsed_ns = self.last_ns.map_or(0, |last_ns| t_ns - last_ns);
        self.last_ns = Some(t_ns);
        let targets =
            |ahead_s: f64| Target { value: target.value + target.rate * ahead_s, rate: target.rate };
        Ok(self.controller.update(&targets, reading, elapsed_ns as f64 * 1e-9))
    }

    /// The controller: to start it where the valve does not follow, to release a fault, to set the model's inputs.
    pub fn controller_mut(&mut self) -> &mut Controller<TwinModel> {
        &mut self.controller
    }
}
