//! The held quantity: model, limits, and which values are in reach.

use crate::failure::{configuration, usage};
use control::inverse::{Model, Quantity};
use control::settings::{Limits, Settings, TARGET_FRACTION};
use control::stepping::CONTACT_SIGMAS;
use control::twin_model::{OUT_OF_REACH_MM, TwinModel, read_model};
use rom::inputs::PRESSURE;
use rom::observable::Observables;
use runtime::config::ActuatorSpec;

/// A quantity with the model that gives it.
pub(super) struct Held {
    pub(super) quantity: Quantity,
    /// Column of the target.
    pub(super) name: String,
    pub(super) unit: &'static str,
    /// Position of the marker whose height is held.
    pub(super) marker: Option<usize>,
    pub(super) settings: Settings,
    pub(super) limits: Limits,
    /// The twin's pressure is the one behind the model's memory.
    pub(super) has_memory: bool,
    model: rom::model::Model,
}

impl Held {
    /// The quantity of a target's column.
    pub(super) fn new(spec: &ActuatorSpec, column: &str) -> anyhow::Result<Self> {
        let mut model = read_model(&spec.model).map_err(configuration)?;
        model.header.set_parameters(spec.given_inputs()).map_err(configuration)?;
        let mut settings = spec.control.clone();
        let (quantity, name, unit) = match column {
            "force_n" => (Quantity::Force, column.to_owned(), "N"),
            "pressure_mpa" => (Quantity::Pressure, column.to_owned(), "MPa"),
            "tip_y_mm" => (Quantity::Observable, column.to_owned(), "mm"),
            "angle_deg" => (Quantity::Observable, angle(&model, &settings)?, "deg"),
            name => (Quantity::Observable, name.to_owned(), unit(&model, name)?),
        };
        let has_memory = settings.take_memory(&model).map_err(configuration)?;
        let marker = if column == "tip_y_mm" { marker(spec)? } else { None };
        let contact_n = CONTACT_SIGMAS * spec.force_sigma_n();
        let range_mpa = model.header.inputs[PRESSURE].range;
        let mut limits = Limits { range_mpa, contact_n, ..Limits::default() };
        if let Some(valve) = &spec.valve {
            (limits.range_mpa, limits.rate_mpa_per_s) = (valve.range_mpa, valve.rate_mpa_per_s);
            settings.force_max_n = settings.force_max_n.min(valve.force_max_n);
        }
        Ok(Self { quantity, name, unit, marker, settings, limits, has_memory, model })
    }

    /// The same quantity with other settings.
    pub(super) fn with(&self, settings: Settings) -> Self {
        let (name, model) = (self.name.clone(), self.model.clone());
        Self { settings, name, model, ..*self }
    }

    /// The model at the point or observable that is held.
    pub(super) fn model(&self, spec: &ActuatorSpec) -> anyhow::Result<TwinModel> {
        let marker = self.marker.and_then(|at| spec.markers.get(at));
        let point = marker.map(|marker| marker.point(&self.model)).transpose().map_err(configuration)?;
        let (_, model) =
            TwinModel::of_column(&self.model, &self.name, point.as_ref()).map_err(configuration)?;
        Ok(model)
    }

    /// Refuses a value that the model's pressures do not give, with the nearest that they do.
    pub(super) fn refuse_out_of_reach(
        &self,
        model: &mut TwinModel,
        values: impl IntoIterator<Item = f64>,
        gap_mm: f64,
    ) -> anyhow::Result<()> {
        let ([low_mpa, high_mpa], known) = (self.limits.range_mpa, model.range_mpa());
        let range_mpa = [low_mpa.max(known[0]), high_mpa.min(known[1])];
        let mut at = |pressure_mpa| self.quantity.of(&model.at(pressure_mpa, gap_mm), pressure_mpa).0;
        let ends = range_mpa.map(&mut at);
        let (low, mut high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        if self.quantity == Quantity::Force {
            high = high.min(TARGET_FRACTION * self.settings.force_max_n);
        }
        let unit = self.unit;
        for value in values {
            if !(low..=high).contains(&value) {
                let gap = if gap_mm >= OUT_OF_REACH_MM {
                    String::new()
                } else {
                    format!(" at a gap of {gap_mm} mm")
                };
                return Err(usage(format!(
                    "{value} {unit} cannot be held{gap}: {} to {} MPa and the force limit give {low:.4} to {high:.4} {unit}; nearest: {:.4} {unit}",
                    range_mpa[0],
                    range_mpa[1],
                    value.clamp(low, high)
                )));
            }
        }
        Ok(())
    }
}

/// Column of the quantity that `control.hold` names.
pub(super) fn column(hold: &str) -> &str {
    match hold {
        "force" => "force_n",
        "tip" => "tip_y_mm",
        "pressure" => "pressure_mpa",
        observable => observable,
    }
}

/// Unit of an observable.
fn unit(model: &rom::model::Model, name: &str) -> anyhow::Result<&'static str> {
    let observables = Observables::of(model).map_err(configuration)?;
    let found = observables.names().zip(observables.units()).find(|(known, _)| *known == name);
    found.map(|(_, unit)| unit).ok_or_else(|| {
        let known: Vec<&str> = observables.names().collect();
        let known = ["force, tip, pressure".to_owned(), known.join(", ")].join(", ");
        configuration(anyhow::anyhow!(
            "control.hold: expected one of {}, found `{name}`",
            known.trim_end_matches(", ")
        ))
    })
}

/// The model's observable in degrees: that of `hold`, or the only one.
fn angle(model: &rom::model::Model, settings: &Settings) -> anyhow::Result<String> {
    let observables = Observables::of(model).map_err(configuration)?;
    let angles: Vec<&str> = observables
        .names()
        .zip(observables.units())
        .filter(|(_, unit)| *unit == "deg")
        .map(|(name, _)| name)
        .collect();
    match (angles.iter().find(|name| **name == settings.hold), angles.as_slice()) {
        (Some(name), _) | (None, [name]) => Ok((*name).to_owned()),
        (None, []) => Err(usage(
            "--angle-deg: expected a model with an observable in degrees, found none; `softtwin train` takes [observables]",
        )),
        (None, several) => {
            Err(usage(format!("--angle-deg: expected control.hold with one of {}", several.join(", "))))
        }
    }
}

/// Position of the marker whose height is held; `None` if the scene has no marker.
fn marker(spec: &ActuatorSpec) -> anyhow::Result<Option<usize>> {
    let names: Vec<&str> = spec.markers.iter().map(|marker| marker.name.as_str()).collect();
    match (&spec.control.marker, names.as_slice()) {
        (None, []) => Ok(None),
        (None, [_]) => Ok(Some(0)),
        (None, several) => Err(usage(format!(
            "--tip-y-mm: expected control.marker with one of the scene's {}",
            several.join(", ")
        ))),
        (Some(name), known) => {
            let at = known.iter().position(|other| other == name);
            let known = if known.is_empty() { "none".into() } else { known.join(", ") };
            at.map(Some).ok_or_else(|| {
                usage(format!("control.marker: expected a marker of the scene ({known}), found `{name}`"))
            })
        }
    }
}
