//! The held quantity as a scene describes it, with its model, settings and limits; and the controller of one, for a loop that is not ours.

use crate::ahead::{TargetSeries, TargetTrend};
use crate::inverse::Quantity;
use crate::law::{Controller, Cycle, Reading, Target};
use crate::settings::{Limits, Settings, table_of};
use crate::twin_model::{TwinModel, TwinModelError};
use rom::inputs::{GAP, MAX_INPUTS, PRESSURE};
use rom::model::Model;
use rom::observable::Observables;
use rom::probe::{MeshPoint, PointError};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Standard deviations of the load cell below which a force is no contact yet.
const CONTACT_SIGMAS: f64 = 3.0;
/// Standard deviation of a load cell without another, N.
pub const FORCE_SIGMA_N: f64 = 0.005;

/// A marker that a camera follows: a node or a point of the undeformed mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MarkerSpec {
    /// Name, for messages.
    pub name: String,
    /// Node number, from 0.
    pub node: Option<u32>,
    /// Undeformed place in the actuator's frame, mm.
    pub at_mm: Option<[f64; 3]>,
}

impl MarkerSpec {
    /// Its point on a model's mesh.
    ///
    /// # Errors
    /// [`PointError`]: no such node, or a point off the mesh.
    pub fn point(&self, model: &Model) -> Result<MeshPoint, PointError> {
        match (self.node, self.at_mm) {
            (Some(node), _) => MeshPoint::node(model, node),
            (None, at_mm) => MeshPoint::at(model, at_mm.unwrap_or([f64::NAN; 3])),
        }
    }
}

#[derive(Debug, Clone, Copy, Deserialize)]
pub struct ValveLimits {
    /// Lowest and highest pressure, MPa.
    pub range_mpa: [f64; 2],
    /// Greatest change, MPa/s.
    #[serde(default = "no_limit")]
    pub rate_mpa_per_s: f64,
    /// Force beyond which the valve closes, N.
    #[serde(default = "no_limit")]
    pub force_max_n: f64,
}

fn no_limit() -> f64 {
    f64::INFINITY
}

/// Noise of the load cell.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(default)]
pub struct Sigma {
    /// Standard deviation, N.
    pub force_n: f64,
}

impl Default for Sigma {
    fn default() -> Self {
        Self { force_n: FORCE_SIGMA_N }
    }
}

/// Tables of an actuator in a scene that concern its controller; the others are the runtime's.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub struct ControlledActuator {
    /// Name of the actuator.
    pub name: String,
    pub control: Settings,
    /// Valve of `pressure_mpa`.
    pub valve: Option<ValveLimits>,
    /// Valves of further cavities.
    pub valves: BTreeMap<String, ValveLimits>,
    /// Noise of the load cell.
    pub sigma: Sigma,
    /// Inputs of the model; the numbers among them are given.
    pub inputs: BTreeMap<String, toml::Value>,
    #[serde(rename = "marker")]
    pub markers: Vec<MarkerSpec>,
}

#[derive(Deserialize)]
struct Scene {
    actuator: Vec<ControlledActuator>,
}

/// Why a quantity cannot be held.
#[derive(Debug, thiserror::Error)]
pub enum HeldError {
    /// The text of the scene.
    #[error("the scene: {0}")]
    Scene(String),
    /// The target names what is not there.
    #[error("{0}")]
    Target(String),
    #[error(transparent)]
    Model(#[from] TwinModelError),
}

impl ControlledActuator {
    /// The actuator of this name in the text of a scene; by default its first.
    ///
    /// # Errors
    /// [`HeldError::Scene`].
    pub fn read(text: &str, name: Option<&str>) -> Result<Self, HeldError> {
        let scene: Scene = toml::from_str(text)
            .map_err(|error| HeldError::Scene(error.to_string().trim_end().to_owned()))?;
        let known: Vec<String> = scene.actuator.iter().map(|one| one.name.clone()).collect();
        let found = scene.actuator.into_iter().find(|one| name.is_none_or(|name| one.name == name));
        let found = found.ok_or_else(|| {
            HeldError::Scene(format!("expected an actuator of {known:?}, found {:?}", name.unwrap_or("")))
        })?;
        let mut problems = found.control.problems("actuator.control");
        if let Some(ValveLimits { range_mpa: [low, high], rate_mpa_per_s, force_max_n }) =
            found.driven_valve()
        {
            if !(low < high && low.is_finite() && high.is_finite()) {
                problems.push(format!(
                    "valve.range_mpa: expected lowest < highest in MPa, found {low} .. {high}"
                ));
            }
            for (name, value) in [("rate_mpa_per_s", rate_mpa_per_s), ("force_max_n", force_max_n)] {
                if value.is_nan() || *value <= 0.0 {
                    problems.push(format!("valve.{name}: expected more than 0, found {value}"));
                }
            }
        }
        if problems.is_empty() { Ok(found) } else { Err(HeldError::Scene(problems.join("; "))) }
    }

    fn driven_valve(&self) -> Option<&ValveLimits> {
        match &self.control.cavity {
            Some(cavity) => self.valves.get(cavity),
            None => self.valve.as_ref(),
        }
    }

    /// Position of the marker whose height is held; `None` without markers.
    fn marker(&self) -> Result<Option<usize>, HeldError> {
        let found = match (&self.control.marker, self.markers.as_slice()) {
            (None, []) => return Ok(None),
            (None, [_]) => Some(0),
            (None, _) => None,
            (Some(name), markers) => markers.iter().position(|marker| marker.name == *name),
        };
        if found.is_none() {
            let known: Vec<&str> = self.markers.iter().map(|marker| marker.name.as_str()).collect();
            let found = self.control.marker.as_deref().unwrap_or("none");
            return Err(HeldError::Target(format!(
                "control.marker: expected a marker of the scene ({}), found `{found}`",
                if known.is_empty() { "it has none".into() } else { known.join(", ") }
            )));
        }
        Ok(found)
    }
}

/// A quantity with the model that gives it.
#[derive(Debug)]
pub struct Held {
    pub quantity: Quantity,
    /// Column of the target: `force_n`, `tip_y_mm`, `pressure_mpa`, or an observable of the model.
    pub name: String,
    pub unit: &'static str,
    /// Position of the marker whose height is held.
    pub marker: Option<usize>,
    /// The driven pressure among the model's inputs.
    pub driven: usize,
    /// Its position among the inputs that states carry.
    pub slot: usize,
    /// Settings; line and play are the model's where it has them.
    pub settings: Settings,
    pub limits: Limits,
    /// The twin's pressure is the one behind the model's memory.
    pub has_memory: bool,
    point: Option<MeshPoint>,
    model: Model,
}

impl Held {
    /// The quantity of a target's column (`angle_deg`: the model's observable in degrees) by the model at the given inputs.
    pub fn new(description: &ControlledActuator, mut model: Model, column: &str) -> Result<Self, HeldError> {
        let number = |value: &toml::Value| value.as_float().or(value.as_integer().map(|whole| whole as f64));
        let given =
            description.inputs.iter().filter_map(|(name, value)| Some((name.as_str(), number(value)?)));
        model.header.set_parameters(given).map_err(TwinModelError::from)?;
        let mut settings = description.control.of(table_of(column)).map_err(HeldError::Scene)?;
        let driven = match &settings.cavity {
            Some(cavity) => {
                let input = model.header.parameter(&format!("pressure_mpa.{cavity}"));
                input.map_err(TwinModelError::from)?
            }
            None => PRESSURE,
        };
        let (quantity, name, unit) = match column {
            "force_n" if driven != PRESSURE => {
                return Err(HeldError::Target(
                    "control.cavity: expected an observable, the tip or a pressure to hold by a further cavity, found the force, whose onset lies along pressure_mpa; leave control.cavity out".into(),
                ));
            }
            "force_n" => (Quantity::Force, column.to_owned(), "N"),
            "pressure_mpa" => (Quantity::Pressure, column.to_owned(), "MPa"),
            "tip_y_mm" => (Quantity::Observable, column.to_owned(), "mm"),
            "angle_deg" => (Quantity::Observable, angle(&model, &settings.hold)?, "deg"),
            name => (Quantity::Observable, name.to_owned(), unit(&model, name)?),
        };
        let has_memory = settings.take_memory(&model, driven)?;
        let marker = if column == "tip_y_mm" { description.marker()? } else { None };
        let point =
            marker.and_then(|at| description.markers.get(at)).map(|marker| marker.point(&model)).transpose();
        let (range_mpa, contact_n) =
            (model.header.inputs[driven].range, CONTACT_SIGMAS * description.sigma.force_n);
        let mut limits = Limits { range_mpa, contact_n, ..Limits::default() };
        if let Some(valve) = description.driven_valve() {
            (limits.range_mpa, limits.rate_mpa_per_s) = (valve.range_mpa, valve.rate_mpa_per_s);
            settings.force_max_n = settings.force_max_n.min(valve.force_max_n);
        }
        if let Some(valve_mpa_per_s) = settings.valve_mpa_per_s {
            limits.rate_mpa_per_s = limits.rate_mpa_per_s.min(valve_mpa_per_s);
        }
        let slot = model.header.taken_inputs().position(|(index, _)| index == driven).unwrap_or(0);
        let point = point.map_err(TwinModelError::from)?;
        Ok(Self { quantity, name, unit, marker, driven, slot, settings, limits, has_memory, point, model })
    }

    /// The same quantity with other settings.
    #[must_use]
    pub fn with(&self, settings: Settings) -> Self {
        let (name, model, point) = (self.name.clone(), self.model.clone(), self.point.clone());
        Self { settings, name, model, point, ..*self }
    }

    /// The model at the point or observable that is held, along the driven pressure.
    ///
    /// # Errors
    /// [`TwinModelError`]: blocks that were not loaded.
    pub fn model(&self) -> Result<TwinModel, TwinModelError> {
        let (_, model) = TwinModel::of_column(&self.model, &self.name, self.point.as_ref())?;
        Ok(model.driven_by(self.driven, &self.model))
    }
}

/// Unit of an observable.
fn unit(model: &Model, name: &str) -> Result<&'static str, TwinModelError> {
    let observables = Observables::of(model)?;
    let found = observables.names().zip(observables.units()).find(|(known, _)| *known == name);
    found.map(|(_, unit)| unit).ok_or_else(|| TwinModelError::NoObservable {
        found: name.to_owned(),
        known: observables.names().map(str::to_owned).collect(),
    })
}

/// The model's observable in degrees: that of `hold`, or the only one.
fn angle(model: &Model, hold: &str) -> Result<String, HeldError> {
    let observables = Observables::of(model).map_err(TwinModelError::from)?;
    let all = observables.names().zip(observables.units());
    let angles: Vec<&str> = all.filter(|(_, unit)| *unit == "deg").map(|(name, _)| name).collect();
    match (angles.iter().find(|name| **name == hold), angles.as_slice()) {
        (Some(name), _) | (None, [name]) => Ok((*name).to_owned()),
        (None, []) => Err(HeldError::Target(
            "angle_deg: expected a model with an observable in degrees, found none; `softtwin train` takes [observables]".into(),
        )),
        (None, several) => {
            Err(HeldError::Target(format!("angle_deg: expected control.hold with one of {}", several.join(", "))))
        }
    }
}

// ---- the controller in a loop that is not ours: stepped by readings with their times, without a bus ----

/// A controller with the time of its last reading.
#[derive(Debug)]
pub struct Stepping {
    controller: Controller<TwinModel>,
    last_ns: Option<u64>,
    trend: TargetTrend,
    /// Positions of the inputs that the model has, among all of the header.
    taken: Vec<usize>,
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
    /// A distance in time that is none.
    #[error("interval_s: expected more than 0 s between two targets, found {found}")]
    Interval { found: f64 },
    /// Inputs that are not the caller's to set.
    #[error(
        "expected finite inputs, NaN for the model's value, and NaN for the gap and the driven pressure, which are those of each step"
    )]
    Inputs,
}

fn finite(name: &'static str, found: f64) -> Result<(), StepError> {
    if found.is_finite() { Ok(()) } else { Err(StepError::NotFinite { name, found }) }
}

impl Stepping {
    /// A controller of what `column` names (`force_n`, `tip_y_mm`, `pressure_mpa`, `angle_deg`, an observable of the model). Of the scene's text it
    /// takes `control`, the driven valve, `sigma.force_n`, markers and given inputs of the actuator (default: the first one); without a
    /// scene the defaults hold.
    pub fn open(
        model: &Model,
        scene: Option<&str>,
        actuator: Option<&str>,
        column: &str,
    ) -> Result<Self, HeldError> {
        let description =
            scene.map(|text| ControlledActuator::read(text, actuator)).transpose()?.unwrap_or_default();
        let held = Held::new(&description, model.clone(), column)?;
        let controller = Controller::new(held.model()?, held.quantity, held.settings, held.limits);
        let taken = model.header.taken_inputs().map(|(index, _)| index).collect();
        Ok(Self { controller, last_ns: None, trend: TargetTrend::default(), taken })
    }

    /// One control cycle at `t_ns`, later than the last one. The target goes on with its rate, and with the rate's change. Never allocates with the
    /// first law. A `measured` or `written_mpa` that is NaN is absent.
    ///
    /// # Errors
    /// [`StepError`]: nothing has changed.
    pub fn step(&mut self, t_ns: u64, target: Target, reading: Reading) -> Result<Cycle, StepError> {
        finite("target", target.value)?;
        finite("rate", target.rate)?;
        let dt_s = self.elapsed_s(t_ns, reading)?;
        let targets = self.trend.step(target, dt_s);
        Ok(self.controller.update(&targets, reading, dt_s))
    }

    /// The same with the values that are known ahead, the first one for now. They should reach as far as the law looks: the first law by delay
    /// and one period of the swing, the predictive one by delay and horizon. After the last value the target stays.
    ///
    /// # Errors
    /// [`StepError`]: nothing has changed.
    pub fn step_ahead(
        &mut self,
        t_ns: u64,
        targets: TargetSeries<'_>,
        reading: Reading,
    ) -> Result<Cycle, StepError> {
        if targets.values.is_empty() {
            return Err(StepError::NotFinite { name: "target", found: f64::NAN });
        }
        targets.values.iter().try_for_each(|value| finite("target", *value))?;
        if !(targets.interval_s > 0.0 && targets.interval_s.is_finite()) {
            return Err(StepError::Interval { found: targets.interval_s });
        }
        let dt_s = self.elapsed_s(t_ns, reading)?;
        self.trend = TargetTrend::default();
        Ok(self.controller.update(&|ahead_s| targets.at(ahead_s), reading, dt_s))
    }

    /// Takes the time of a reading; returns the time since the last one, s.
    fn elapsed_s(&mut self, t_ns: u64, reading: Reading) -> Result<f64, StepError> {
        finite("pressure_mpa", reading.pressure_mpa)?;
        finite("gap_mm", reading.gap_mm)?;
        if let Some(last_ns) = self.last_ns.filter(|last_ns| t_ns <= *last_ns) {
            return Err(StepError::NotLater { last_ns, found_ns: t_ns });
        }
        let elapsed_ns = self.last_ns.map_or(0, |last_ns| t_ns - last_ns);
        self.last_ns = Some(t_ns);
        Ok(elapsed_ns as f64 * 1e-9)
    }

    /// Sets inputs of the model for the cycles that follow, one value for each of the header's; NaN: the model's.
    ///
    /// # Errors
    /// [`StepError::Inputs`]; nothing has changed.
    pub fn set_inputs(&mut self, inputs: &[f64]) -> Result<(), StepError> {
        let model = self.controller.model_mut();
        let is_given = |input: usize| inputs.get(input).is_some_and(|value| !value.is_nan());
        if [model.driven(), GAP].into_iter().any(is_given) || inputs.iter().any(|value| value.is_infinite()) {
            return Err(StepError::Inputs);
        }
        let mut values = [f64::NAN; MAX_INPUTS];
        let taken = self.taken.iter().map(|at| inputs.get(*at).copied().unwrap_or(f64::NAN));
        values.iter_mut().zip(taken).for_each(|(to, value)| *to = value);
        model.set_inputs(&values);
        Ok(())
    }

    /// The controller: to start it where the valve does not follow, to release a fault.
    pub fn controller_mut(&mut self) -> &mut Controller<TwinModel> {
        &mut self.controller
    }
}
