//! Settings in a scene file, whose other lines and comments stay.

use crate::failure::configuration;
use anyhow::anyhow;
use control::settings::Settings;
use formats::file;
use serde_json::{Value, json};
use std::path::Path;
use toml_edit::{DocumentMut, Item, TableLike, value};

/// A key of a scene with its value; null: the key is not in the scene.
type Key = (&'static str, Value);

/// Keys that an experiment sets: those of valve and line, and those of the held quantity.
pub(super) fn keys(settings: &Settings) -> ([Key; 3], [Key; 5]) {
    // Four digits: more are noise.
    let short = |value: f64| format!("{value:.3e}").parse::<f64>().unwrap_or(value);
    let plays = settings
        .play
        .iter()
        .map(|play| json!({ "threshold": short(play.threshold), "weight": short(play.weight) }));
    let of_line = [
        ("line", json!({ "fill_s": short(settings.line.fill_s), "empty_s": short(settings.line.empty_s) })),
        ("delay_s", json!(short(settings.delay_s))),
        ("valve_mpa_per_s", json!(settings.valve_mpa_per_s.map(short))),
    ];
    let of_quantity = [
        ("play", plays.collect()),
        ("swing_hz", json!(short(settings.swing_hz))),
        ("swing_damping", json!(short(settings.swing_damping))),
        ("approach_s", json!(short(settings.approach_s))),
        ("correction_s", json!(short(settings.correction_s))),
    ];
    (of_line, of_quantity)
}

/// Writes the keys to the actuator at `index`: those of the line to its `control`, those of the quantity to the table of this name in it.
pub(super) fn write(path: &Path, index: usize, quantity: &str, settings: &Settings) -> anyhow::Result<()> {
    let place = || path.display().to_string();
    let text = file::read_text(path, file::MAX_TEXT_BYTES).map_err(configuration)?;
    let mut document: DocumentMut = text.parse().map_err(configuration)?;
    let actuators = document.get_mut("actuator").and_then(Item::as_array_of_tables_mut);
    let actuator = actuators.and_then(|actuators| actuators.get_mut(index));
    let actuator = actuator.ok_or_else(|| configuration(anyhow!("{}: expected [[actuator]]", place())))?;
    let no_table = |name: &str| configuration(anyhow!("{}: expected a table {name}", place()));
    let control = actuator.entry("control").or_insert(toml_edit::table());
    let control = control.as_table_like_mut().ok_or_else(|| no_table("control"))?;
    let (of_line, of_quantity) = keys(settings);
    set(control, of_line);
    let own = control.entry(quantity).or_insert(toml_edit::table());
    set(own.as_table_like_mut().ok_or_else(|| no_table(quantity))?, of_quantity);
    crate::files::save(path, document.to_string().as_bytes())
}

fn set(table: &mut dyn TableLike, keys: impl IntoIterator<Item = Key>) {
    for (key, given) in keys {
        if given.is_null() {
            table.remove(key);
            continue;
        }
        let decor = table.get(key).and_then(Item::as_value).map(|old| old.decor().clone());
        let mut new = inline(&given);
        if let Some(decor) = decor {
            *new.decor_mut() = decor;
        }
        table.insert(key, value(new));
    }
}

fn inline(value: &Value) -> toml_edit::Value {
    match value {
        Value::Array(items) => items.iter().map(inline).collect::<toml_edit::Array>().into(),
        Value::Object(items) => items
            .iter()
            .map(|(key, value)| (key.as_str(), inline(value)))
            .collect::<toml_edit::InlineTable>()
            .into(),
        other => other.as_f64().unwrap_or(f64::NAN).into(),
    }
}
