//! The unknowns of a scene with the sensors that tell them: what `calibrate` and `calibrate --plan` begin with.

use crate::failure::{configuration, usage};
use crate::files;
use anyhow::Context;
use estimate::Setup;
use rom::model::{Model, ModelHeader};
use rom::session::{Gaps, Session};
use runtime::config::{ActuatorSpec, Scene};
use runtime::estimation::{self, SensorModel};
use std::path::Path;

/// One actuator that estimates something.
pub struct Unknowns {
    /// Its part of the scene.
    pub spec: ActuatorSpec,
    /// Unknowns, inputs, measured values.
    pub setup: Setup,
    /// The model's predictions of these values.
    pub sensors: SensorModel,
    /// The small part of its model, with the scene's values of parameters.
    pub header: ModelHeader,
    /// The model without a past.
    pub session: Session,
}

impl Unknowns {
    /// Unknowns of the named actuator, or of the only one that estimates something.
    pub fn load(scene: &Scene, path: &Path, actuator: Option<&str>) -> anyhow::Result<Self> {
        let spec = spec(scene, path, actuator)?.clone();
        let mut model = files::model(&spec.model)?;
        model.header.set_parameters(spec.given_inputs()).map_err(configuration)?;
        Self::of(spec, &model)
    }

    /// Unknowns of an actuator with a model.
    pub fn of(spec: ActuatorSpec, model: &Model) -> anyhow::Result<Self> {
        let setup = estimation::setup(&spec, model).map_err(problems)?;
        let sensors = SensorModel::new(&spec, model).map_err(problems)?;
        let session = Session::with_volumes(model, Gaps::Live).map_err(configuration)?;
        Ok(Self { spec, setup, sensors, header: model.header.clone(), session })
    }
}

/// All errors, one per line.
pub fn problems(messages: Vec<String>) -> anyhow::Error {
    configuration(anyhow::anyhow!("{}", messages.join("\n")))
}

fn spec<'a>(scene: &'a Scene, path: &Path, actuator: Option<&str>) -> anyhow::Result<&'a ActuatorSpec> {
    let with = |spec: &&ActuatorSpec| !spec.estimate.is_empty();
    let names: Vec<&str> = scene.actuators.iter().filter(with).map(|spec| spec.name.as_str()).collect();
    match (actuator, names.as_slice()) {
        (Some(name), found) => {
            scene.actuators.iter().filter(with).find(|spec| spec.name == *name).ok_or_else(|| {
                usage(format!("--actuator {name}: the scene estimates something for {found:?} only"))
            })
        }
        (None, [_]) => scene.actuators.iter().find(with).context("an actuator"),
        (None, []) => Err(configuration(anyhow::anyhow!(
            "{}: expected [actuator.estimate] with at least one unknown, found none",
            path.display()
        ))),
        (None, several) => {
            Err(usage(format!("several actuators have unknowns: {several:?}; name one with --actuator")))
        }
    }
}
