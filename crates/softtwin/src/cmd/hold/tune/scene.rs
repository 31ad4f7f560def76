//! Settings in a scene file, whose other lines and comments stay.

use crate::failure::configuration;
use anyhow::{Context, anyhow};
use control::settings::Settings;
use serde_json::{Value, json};
use std::path::Path;
use toml_edit::{DocumentMut, Item, value};

/// Keys of `[actuator.control]` that an experiment sets; null: the key is not in the scene.
pub(super) fn keys(settings: &Settings) -> [(&'static str, Value); 8] {
    // Four digits: more are noise.
    let short = |value: f64| format!("{value:.3e}").parse::<f64>().unwrap_or(value);
    let plays = settings
        .play
        .iter()
        .map(|play| json!({ "threshold": short(play.threshold), "weight": short(play.weight) }));
    [
        ("line", json!({ "fill_s": short(settings.line.fill_s), "empty_s": short(settings.line.empty_s) })),
        ("delay_s", json!(short(settings.delay_s))),
        ("valve_mpa_per_s", json!(settings.valve_mpa_per_s.map(short))),
        ("play", plays.collect()),
        ("swing_hz", json!(short(settings.swing_hz))),
        ("swing_damping", json!(short(settings.swing_damping))),
        ("approach_s", json!(short(settings.approach_s))),
        ("correction_s", json!(short(settings.correction_s))),
    ]
}

/// Writes the keys to the `at`-th actuator.
pub(super) fn write(path: &Path, at: usize, settings: &Settings) -> anyhow::Result<()> {
    let place = || path.display().to_string();
    let text = std::fs::read_to_string(path).with_context(place)?;
    let mut document: DocumentMut = text.parse().map_err(configuration)?;
    let actuators = document.get_mut("actuator").and_then(Item::as_array_of_tables_mut);
    let actuator = actuators.and_then(|actuators| actuators.get_mut(at));
    let actuator = actuator.ok_or_else(|| configuration(anyhow!("{}: expected [[actuator]]", place())))?;
    let control = actuator.entry("control").or_insert(toml_edit::table());
    let control = control.as_table_like_mut();
    let control = control.ok_or_else(|| configuration(anyhow!("{}: expected a table control", place())))?;
    for (key, of) in keys(settings) {
        if of.is_null() {
            control.remove(key);
            continue;
        }
        let decor = control.get(key).and_then(Item::as_value).map(|old| old.decor().clone());
        let mut new = inline(&of);
        if let Some(decor) = decor {
            *new.decor_mut() = decor;
        }
        control.insert(key, value(new));
    }
    crate::files::save(path, document.to_string().as_bytes())
}

fn inline(of: &Value) -> toml_edit::Value {
    match of {
        Value::Array(items) => items.iter().map(inline).collect::<toml_edit::Array>().into(),
        Value::Object(items) => items
            .iter()
            .map(|(key, of)| (key.as_str(), inline(of)))
            .collect::<toml_edit::InlineTable>()
            .into(),
        other => other.as_f64().unwrap_or(f64::NAN).into(),
    }
}
