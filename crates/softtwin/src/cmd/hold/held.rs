//! The held quantity of a scene, and which values are in reach.

use crate::failure::{configuration, usage};
use crate::files;
use control::held::{Held, HeldError};
use control::inverse::{Model, Quantity};
use control::settings::TARGET_FRACTION;
use control::twin_model::{OUT_OF_REACH_MM, TwinModel};
use runtime::config::ActuatorSpec;

/// The quantity of a target's column; without a sensor of it the model's value is held.
pub(super) fn of_column(spec: &ActuatorSpec, column: &str) -> anyhow::Result<Held> {
    let model = files::model(&spec.model)?;
    let held = Held::new(&spec.controlled(), model, column).map_err(|error| match error {
        HeldError::Target(_) => usage(error.to_string()),
        _ => configuration(error),
    });
    let mut held = held?;
    held.settings.is_measured &= held.quantity != Quantity::Observable
        || held.marker.is_some()
        || spec.observables.contains_key(&held.name);
    Ok(held)
}

/// Refuses a value that the model's pressures do not give, with the nearest that they do.
pub(super) fn refuse_out_of_reach(
    held: &Held,
    model: &mut TwinModel,
    values: impl IntoIterator<Item = f64>,
    gap_mm: f64,
) -> anyhow::Result<()> {
    let ([low_mpa, high_mpa], known) = (held.limits.range_mpa, model.range_mpa());
    let range_mpa = [low_mpa.max(known[0]), high_mpa.min(known[1])];
    let mut value = |pressure_mpa| held.quantity.of(&model.at(pressure_mpa, gap_mm), pressure_mpa).0;
    let ends = range_mpa.map(&mut value);
    let (low, mut high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
    if held.quantity == Quantity::Force {
        high = high.min(TARGET_FRACTION * held.settings.force_max_n);
    }
    let unit = held.unit;
    for value in values {
        if !(low..=high).contains(&value) {
            let gap =
                if gap_mm >= OUT_OF_REACH_MM { String::new() } else { format!(" at a gap of {gap_mm} mm") };
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

/// Column of the quantity that `control.hold` names.
pub(super) fn column(hold: &str) -> &str {
    match hold {
        "force" => "force_n",
        "tip" => "tip_y_mm",
        "pressure" => "pressure_mpa",
        observable => observable,
    }
}
