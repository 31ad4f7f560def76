//! Samples as JSON.

use super::text::range;
use recording::message::Json;
use serde_json::{Map, Value, json};
use wire::layout::{field_id, flags, regime, unpack_name};
use wire::{AnySample, FieldSample};

/// The sample as JSON; a field as its header and the range of each of its fields.
pub fn sample(sample: &AnySample) -> anyhow::Result<Value> {
    match sample {
        AnySample::Field(sample) => Ok(field(sample)),
        _ => Ok(serde_json::to_value(Json(sample.view()))?),
    }
}

fn field(sample: &FieldSample) -> Value {
    let header = sample.header();
    let fields: Map<String, Value> = header
        .fields()
        .filter_map(|id| {
            let (min, max) = range(sample.field(id)?);
            Some((field_id::as_str(id).to_owned(), json!({ "min": min, "max": max })))
        })
        .collect();
    json!({
        "seq": header.seq,
        "sensor_seq": header.sensor_seq,
        "t_sensor_ns": header.t_sensor_ns,
        "t_publish_ns": header.t_publish_ns,
        "pressure_mpa": header.pressure_mpa,
        "gap_mm": header.gap_mm,
        "contact_force_n": header.contact_force_n,
        "max_von_mises_mpa": header.max_von_mises_mpa,
        "max_von_mises_node": header.max_von_mises_node,
        "regime": regime::as_str(header.regime),
        "flags": flags::names(header.flags).collect::<Vec<_>>(),
        "node_set": unpack_name(&header.node_set),
        "nodes": header.node_count,
        "entries": header.entries(),
        "fields": fields,
    })
}
