//! `softtwin hold`.

mod args;
mod goal;
mod held;
mod live;
mod sensors;
mod simulate;
mod states;
mod tally;
pub mod tune;

pub use args::Args;

use crate::failure::{configuration, usage};
use anyhow::Context;
use args::TargetArgs;
use goal::Goal;
use runtime::config::{ActuatorSpec, Scene};

impl TargetArgs {
    /// Column of the held quantity with its targets; `None` without any.
    fn goal(&self) -> anyhow::Result<Option<(&'static str, Goal)>> {
        let values = [
            ("force_n", self.force_n),
            ("tip_y_mm", self.tip_y_mm),
            ("angle_deg", self.angle_deg),
            ("pressure_mpa", self.pressure_mpa),
        ];
        let given = values.iter().find_map(|(name, value)| Some((*name, Goal::step((*value)?))));
        match (given, &self.trace) {
            (Some(given), _) => Ok(Some(given)),
            (None, Some(trace)) => Goal::read(trace, &values.map(|(name, _)| name)).map(Some),
            (None, None) => Ok(None),
        }
    }
}

impl Args {
    /// Runs the loop on the actuator, or on a simulated one.
    pub fn run(self) -> anyhow::Result<()> {
        let scene = Scene::load(&self.scene).map_err(configuration)?;
        let (_, spec) = actuator(&scene, self.actuator.as_deref())?;
        let (column, goal) = match self.target.goal()? {
            Some((column, goal)) => (column, Some(goal)),
            None => (held::column(&spec.control.hold), None),
        };
        let held = held::of_column(spec, column)?;
        match (self.simulate, goal) {
            (false, goal) => live::run(&self, spec, held, goal),
            (true, Some(goal)) => simulate::run(&self, spec, held, &goal),
            (true, None) => Err(usage("--simulate: expected a target, such as --force-n 0.3, found none")),
        }
    }
}

/// An actuator of a scene by name, with its position; without a name the first.
fn actuator<'a>(scene: &'a Scene, name: Option<&str>) -> anyhow::Result<(usize, &'a ActuatorSpec)> {
    let is_meant = |(_, spec): &(usize, &ActuatorSpec)| name.is_none_or(|name| name == spec.name);
    let names = || scene.actuators.iter().map(|spec| spec.name.clone()).collect::<Vec<_>>().join(", ");
    let found = scene.actuators.iter().enumerate().find(is_meant);
    found.with_context(|| format!("--actuator: expected one of the scene's ({})", names())).map_err(usage)
}
