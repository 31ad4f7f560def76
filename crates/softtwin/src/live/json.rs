//! Samples as JSON.

use super::text::range;
use recording::message::Json;
use serde_json::{Map, Value, json};
use wire::layout::field_id;
use wire::{AnySample, FieldSample};

/// The sample as JSON; a field as its header, with the range of each of its fields instead of all values.
pub fn sample(sample: &AnySample) -> anyhow::Result<Value> {
    let mut value = serde_json::to_value(Json::new(sample.view()))?;
    if let AnySample::Field(field) = sample {
        value["nodes"] = json!(field.header().node_count);
        value["entries"] = json!(field.header().entries());
        value["fields"] = Value::Object(ranges(field));
    }
    Ok(value)
}

fn ranges(sample: &FieldSample) -> Map<String, Value> {
    let range = |id| {
        let (min, max) = range(sample.field(id)?);
        Some((field_id::as_str(id).to_owned(), json!({ "min": min, "max": max })))
    };
    sample.header().fields().filter_map(range).collect()
}
