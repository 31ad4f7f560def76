//! Common parts of the commands that show live data: shared-memory domain, topics by key expression, readers, waiting, JSON.

mod readers;

pub use readers::Readers;
pub use softtwind::latency::{Latencies, PercentilesUs};
pub use softtwind::text;

use crate::failure::usage;
use recording::message::Json;
use serde_json::{Map, Value, json};
use std::path::PathBuf;
use wire::layout::field_id;
use wire::{AnySample, Bus, Domain, FieldSample, KeyExpr, TopicInfo, WireError};

/// Which programs see one another.
#[derive(Debug, Clone, clap::Args)]
pub struct DomainArgs {
    /// Shared-memory domain [default: $SOFTTWIN_DOMAIN, or iceoryx2's own].
    #[arg(long, value_name = "NAME")]
    domain: Option<String>,
    /// Folder of management files [default: $SOFTTWIN_ROOT, or iceoryx2's].
    #[arg(long, value_name = "DIR")]
    domain_root: Option<PathBuf>,
}

impl DomainArgs {
    /// Joins the shared-memory domain.
    pub fn join(&self) -> Result<Bus, WireError> {
        Bus::open(&self.domain())
    }

    /// The selected shared-memory domain.
    pub fn domain(&self) -> Domain {
        let from_env = Domain::from_env();
        let prefix = self.domain.as_deref().map_or(from_env.prefix, |name| Domain::named(name).prefix);
        let root = self.domain_root.as_ref().map(|root| root.display().to_string()).or(from_env.root);
        Domain { prefix, root }
    }
}

/// Parses a key expression; the error names the invalid part.
pub fn key(text: &str) -> anyhow::Result<KeyExpr> {
    KeyExpr::new(text).map_err(usage)
}

/// All topics that `key` matches; none is an error that says what to do.
pub fn find(bus: &Bus, key: &KeyExpr) -> anyhow::Result<Vec<TopicInfo>> {
    let found = bus.topics(key)?;
    if !found.is_empty() {
        return Ok(found);
    }
    let all = bus.names(&self::key("softtwin/**")?)?;
    if all.is_empty() {
        anyhow::bail!(
            "no topic in this shared memory. Start `softtwind twin --scene config/scenes/finger.toml`, or \
             name the twin's domain with --domain"
        );
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
