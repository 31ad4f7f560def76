//! Shared parts of the commands that show live data: shared-memory domain, topics by key expression, readers, JSON.

mod owner;
mod readers;

pub use owner::Owner;
pub use readers::Readers;
pub use softtwind::DomainArgs;
pub use softtwind::latency::{Latencies, PercentilesUs};
pub use softtwind::text;

use crate::failure::usage;
use recording::message::Json;
use serde_json::{Map, Value, json};
use wire::layout::field_id;
use wire::{AnySample, Bus, FieldSample, KeyExpr, TopicInfo};

/// Parses a key expression; the error names the invalid part.
pub fn key(text: &str) -> anyhow::Result<KeyExpr> {
    KeyExpr::new(text).map_err(usage)
}

/// Remedy for a shared memory without topics.
pub const NO_TOPIC: &str = "no topic in this shared memory. Start `softtwind twin --scene config/scenes/finger.toml`, or name the twin's \
                            domain with --domain";

/// All topics that `key` matches; an error with its remedy if there is none.
pub fn find(bus: &Bus, key: &KeyExpr) -> anyhow::Result<Vec<TopicInfo>> {
    let found = bus.topics(key)?;
    if !found.is_empty() {
        return Ok(found);
    }
    let all = bus.names(&self::key("softtwin/**")?)?;
    if all.is_empty() {
        anyhow::bail!(NO_TOPIC);
    }
    let names: Vec<&str> = all.iter().map(|topic| topic.name()).collect();
    anyhow::bail!("no topic matches `{key}`; there are:\n  {}", names.join("\n  "));
}

/// A sample as JSON; a field as its header with the range of each component instead of the values.
pub fn sample_json(sample: &AnySample) -> anyhow::Result<Value> {
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
        let (min, max) = text::range(sample.field(id)?);
        Some((field_id::as_str(id).to_owned(), json!({ "min": min, "max": max })))
    };
    sample.header().fields().filter_map(range).collect()
}
