//! The controller in a loop that is not ours: made of a model and a scene's file, stepped by readings with their times, without a bus.

use crate::law::{Controller, Cycle, Reading, Target};
use crate::settings::{Limits, Settings};
use crate::twin_model::{TwinModel, TwinModelError};
use rom::inputs::PRESSURE;
use rom::model::Model;
use rom::probe::MeshPoint;
use serde::Deserialize;
use std::collections::BTreeMap;

/// Longest time of one control cycle, s.
pub const LONGEST_S: f64 = 0.1;
/// Standard deviations of the load cell below which a force is no contact yet.
pub const CONTACT_SIGMAS: f64 = 3.0;

/// A controller with the time of its last reading.
#[derive(Debug)]
pub struct Stepping {
    controller: Controller<TwinModel>,
    last_ns: Option<u64>,
}

/// Why there is no controller.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// The text of the scene.
    #[error("the scene: {0}")]
    Scene(String),
    /// The model.
    #[error(transparent)]
    Model(#[from] TwinModelError),
}

/// Why a reading was refused; nothing has changed, and the setpoint before expires.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum StepError {
    /// A time that is not later.
    #[error("expected a time later than the last reading's, {last_ns} ns, found {found_ns} ns")]
    NotLater {
        /// Time of the last reading.
        last_ns: u64,
        /// Time of this one.
        found_ns: u64,
    },
    /// A value that has to be a number.
    #[error("{name}: expected a number, found {found}")]
    NotFinite {
        /// Name of the value.
        name: &'static str,
        /// The value.
        found: f64,
    },
}

/// Tables of an actuator in a scene that concern its controller; the others are the runtime's.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Actuator {
    name: String,
    control: Settings,
    valve: Option<Valve>,
    sigma: Sigma,
    inputs: BTreeMap<String, toml::Value>,
    marker: Vec<Marker>,
}

#[derive(Debug, Deserialize)]
struct Valve {
    range_mpa: [f64; 2],
    rate_mpa_per_s: Option<f64>,
    force_max_n: Option<f64>,
}

#[derive(Debug, Deserialize)]
#[serde(default)]
struct Sigma {
    force_n: f64,
}

impl Default for Sigma {
    /// That of a scene.
    fn default() -> Self {
        Self { force_n: 0.005 }
    }
}

#[derive(Debug, Deserialize)]
struct Marker {
    name: String,
    node: Option<u32>,
    at_mm: Option<[f64; 3]>,
}

#[derive(Debug, Deserialize)]
struct Scene {
    actuator: Vec<Actuator>,
}

impl Actuator {
    /// The actuator of this name in the text of a scene; by default its first.
    fn read(text: &str, name: Option<&str>) -> Result<Self, String> {
        let scene: Scene = toml::from_str(text).map_err(|error| error.to_string().trim_end().to_owned())?;
        let known: Vec<String> = scene.actuator.iter().map(|one| one.name.clone()).collect();
        let found = scene.actuator.into_iter().find(|one| name.is_none_or(|name| one.name == name));
        let found = found
            .ok_or_else(|| format!("expected an actuator of {known:?}, found {:?}", name.unwrap_or("")))?;
        let mut problems = found.control.problems("actuator.control");
        if let Some(Valve { range_mpa: [low, high], rate_mpa_per_s, force_max_n }) = found.valve {
            if !(low < high && low.is_finite() && high.is_finite()) {
                problems.push(format!(
                    "actuator.valve.range_mpa: expected lowest < highest in MPa, found {low} .. {high}"
                ));
            }
            for (name, value) in [("rate_mpa_per_s", rate_mpa_per_s), ("force_max_n", force_max_n)] {
                if let Some(value) = value.filter(|value| value.is_nan() || *value <= 0.0) {
                    problems.push(format!("actuator.valve.{name}: expected more than 0, found {value}"));
                }
            }
        }
        if problems.is_empty() { Ok(found) } else { Err(problems.join("; ")) }
    }

    /// Place of the marker whose height is held; `None` without markers.
    fn marker(&self, model: &Model) -> Result<Option<MeshPoint>, OpenError> {
        let known: Vec<&str> = self.marker.iter().map(|marker| marker.name.as_str()).collect();
        let found = match (&self.control.marker, self.marker.as_slice()) {
            (None, []) => return Ok(None),
            (None, [one]) => Some(one),
            (None, _) => None,
            (Some(name), markers) => markers.iter().find(|marker| marker.name == *name),
        };
        let Some(marker) = found else {
            let found = self.control.marker.as_deref().unwrap_or("none");
            return Err(OpenError::Scene(format!(
                "control.marker: expected one of {known:?}, found {found}"
            )));
        };
        let point = match (marker.node, marker.at_mm) {
            (Some(node), _) => MeshPoint::node(model, node),
            (None, at_mm) => MeshPoint::at(model, at_mm.unwrap_or([f64::NAN; 3])),
        };
        Ok(Some(point.map_err(TwinModelError::from)?))
    }

    fn limits(&self, model: &Model) -> Limits {
        let (range_mpa, contact_n) =
            (model.header.inputs[PRESSURE].range, CONTACT_SIGMAS * self.sigma.force_n);
        let mut limits = Limits { range_mpa, contact_n, ..Limits::default() };
        if let Some(valve) = &self.valve {
            limits.range_mpa = valve.range_mpa;
            limits.rate_mpa_per_s = valve.rate_mpa_per_s.unwrap_or(f64::INFINITY);
        }
        limits
    }
}

impl Stepping {
    /// A controller of what `column` names (`force_n`, `tip_y_mm`, `pressure_mpa`, an observable of the model). Of the scene's text it takes
    /// `control`, `valve`, `sigma.force_n`, markers and given inputs of the actuator (default: the first one); without a scene the defaults hold.
    ///
    /// # Errors
    /// [`OpenError`].
    pub fn open(
        model: &Model,
        scene: Option<&str>,
        actuator: Option<&str>,
        column: &str,
    ) -> Result<Self, OpenError> {
        let spec = scene.map(|text| Actuator::read(text, actuator)).transpose().map_err(OpenError::Scene)?;
        let spec = spec.unwrap_or_default();
        let given: Vec<(&str, f64)> = spec
            .inputs
            .iter()
            .filter_map(|(name, value)| {
                Some((name.as_str(), value.as_float().or(value.as_integer().map(|whole| whole as f64))?))
            })
            .collect();
        let with_given;
        let model = if given.is_empty() {
            model
        } else {
            let mut own = model.clone();
            own.header.set_parameters(given).map_err(TwinModelError::from)?;
            with_given = own;
            &with_given
        };
        let marker = if column == "tip_y_mm" { spec.marker(model)? } else { None };
        let (quantity, held) = TwinModel::of_column(model, column, marker.as_ref())?;
        let limits = spec.limits(model);
        let mut settings = spec.control;
        settings.take_memory(model)?;
        let force_max_n = spec.valve.and_then(|valve| valve.force_max_n).unwrap_or(f64::INFINITY);
        settings.force_max_n = settings.force_max_n.min(force_max_n);
        Ok(Self { controller: Controller::new(held, quantity, settings, limits), last_ns: None })
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
        let targets = |ahead_s: f64| Target { value: target.value + target.rate * ahead_s, ..target };
        Ok(self.controller.update(&targets, reading, (elapsed_ns as f64 * 1e-9).min(LONGEST_S)))
    }

    /// The controller: to start it where the valve does not follow, to release a fault, to set the model's inputs.
    pub fn controller_mut(&mut self) -> &mut Controller<TwinModel> {
        &mut self.controller
    }
}
