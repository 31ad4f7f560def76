//! Subject of a comparison with a recording: a model, or that of a scene's actuator.

use crate::failure::{configuration, usage};
use crate::files;
use anyhow::Context;
use rom::inputs::{Inputs, PRESSURE};
use rom::model::Model;
use runtime::config::{ActuatorSpec, BIASES, Scene};
use std::path::Path;

/// A model with the values of its inputs that the recording does not have, and the biases of the sensors.
pub struct Subject {
    pub model: Model,
    pub pressure_bias_mpa: f64,
    pub force_bias_n: f64,
}

impl Subject {
    /// A model file, or a scene with one actuator.
    pub fn read(path: &Path) -> anyhow::Result<Self> {
        if path.extension().is_none_or(|ending| ending != "toml") {
            return Ok(Self { model: files::model(path)?, pressure_bias_mpa: 0.0, force_bias_n: 0.0 });
        }
        let scene = Scene::load(path).map_err(configuration)?;
        let [spec] = scene.actuators.as_slice() else {
            let found = scene.actuators.len();
            return Err(usage(format!(
                "{}: expected a scene with one actuator, found {found}",
                path.display()
            )));
        };
        Self::of(spec).with_context(|| path.display().to_string())
    }

    fn of(spec: &ActuatorSpec) -> anyhow::Result<Self> {
        let mut model = files::model(&spec.model)?;
        let estimated = spec.estimate.iter().map(|(name, unknown)| (name.as_str(), unknown.prior));
        let of_model = estimated.filter(|(name, _)| !BIASES.contains(name) && *name != "gap_mm");
        model.header.set_parameters(spec.given_inputs().chain(of_model)).map_err(configuration)?;
        let bias = |name: &str| spec.estimate.get(name).map_or(0.0, |unknown| unknown.prior);
        Ok(Self { model, pressure_bias_mpa: bias(BIASES[0]), force_bias_n: bias(BIASES[1]) })
    }

    /// Inputs without the gauge's bias.
    pub fn unbiased(&self, inputs: Inputs) -> Inputs {
        inputs.with(PRESSURE, inputs.pressure_mpa() - self.pressure_bias_mpa)
    }
}
