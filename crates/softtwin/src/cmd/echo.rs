//! `softtwin echo`.

use crate::failure::usage;
use crate::live::{self, DomainArgs, Readers};
use crate::output;
use serde_json::json;
use std::io::IsTerminal;
use std::time::Duration;
use wire::layout::field_id;
use wire::{AnySample, FieldSample};

const EXAMPLES: &str = "\
Examples:
  softtwin echo softtwin/finger/state
  softtwin echo 'softtwin/*/state' --json
  softtwin echo softtwin/finger/field --once
  softtwin echo softtwin/finger/field --field von_mises --once   all values of one field
  softtwin echo softtwin/finger/field --node 1200 --count 10     all fields of one node

A field is shown as a summary unless --field or --node is given. Ctrl-C ends.";

/// Width that a terminal always has.
const COLUMNS: usize = 80;

/// Print published samples, one line per sample.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Topic or key expression.
    #[arg(value_name = "KEY")]
    key: String,
    /// End after one sample.
    #[arg(long, conflicts_with = "count", help_heading = "Selection")]
    once: bool,
    /// End after this number of samples (1 to 1000000000000).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000_000_000), help_heading = "Selection")]
    count: Option<u64>,
    /// End after this number of seconds; without a sample an error.
    #[arg(long, value_name = "S", value_parser = crate::range::seconds, help_heading = "Selection")]
    seconds: Option<f64>,
    /// All values of this field (x, y, z, displacement, von_mises) of field topics.
    #[arg(long, value_name = "NAME", help_heading = "Selection")]
    field: Option<String>,
    /// The values of this node of field topics, numbered within the topic's node set.
    #[arg(long, value_name = "N", value_parser = crate::range::count(0, 1_000_000_000), help_heading = "Selection")]
    node: Option<usize>,
    /// One JSON object per line.
    #[arg(long, help_heading = "Output")]
    json: bool,
    #[command(flatten)]
    domain: DomainArgs,
}

impl Args {
    /// Shows samples until the end that the arguments name.
    pub fn run(self) -> anyhow::Result<()> {
        let field = self.field.as_deref().map(field_number).transpose()?;
        let limit = self.seconds.map(Duration::from_secs_f64);
        let bus = self.domain.join()?;
        let mut readers = Readers::open(&bus, &live::key(&self.key)?, limit)?;
        let topics: Vec<String> = readers.topics().map(|topic| topic.name().to_owned()).collect();
        let wanted = if self.once { 1 } else { self.count.unwrap_or(u64::MAX) };
        let mut shown = 0;
        while shown < wanted {
            if let Some((index, sample)) = readers.next()? {
                self.show(&topics[index], &sample, field)?;
                shown += 1;
            } else if !readers.wait(Duration::from_secs(1))? {
                break;
            }
        }
        anyhow::ensure!(
            shown > 0 || self.seconds.is_none(),
            "nothing was published on `{}`; is the bridge running? `softtwin list --rate '{}'` shows the rate",
            self.key,
            self.key
        );
        Ok(())
    }

    fn show(&self, topic: &str, sample: &AnySample, field: Option<u8>) -> anyhow::Result<()> {
        if let AnySample::Field(values) = sample
            && (field.is_some() || self.node.is_some())
        {
            return self.show_values(topic, values, field);
        }
        if self.json {
            return output::json(&json!({ "topic": topic, "sample": live::sample_json(sample)? }));
        }
        let line = format!("{topic}  {}", live::text::sample(sample));
        let is_terminal = std::io::stdout().is_terminal();
        Ok(output!("{}", if is_terminal { fold(&line, COLUMNS) } else { line })?)
    }

    /// One field, one node, or one value.
    fn show_values(&self, topic: &str, sample: &FieldSample, field: Option<u8>) -> anyhow::Result<()> {
        let header = sample.header();
        let nodes = header.node_count;
        if let Some(node) = self.node.filter(|node| *node >= nodes as usize) {
            return Err(usage(format!("--node {node}: {topic} has {nodes} nodes, numbered from 0")));
        }
        let ids: Vec<u8> = field.map_or_else(|| header.fields().collect(), |id| vec![id]);
        let mut out = serde_json::Map::new();
        for id in ids {
            let name = field_id::as_str(id);
            let values = sample.field(id).ok_or_else(|| {
                let known: Vec<&str> = header.fields().map(field_id::as_str).collect();
                usage(format!("--field {name}: {topic} has {}", known.join(", ")))
            })?;
            let chosen = self.node.map_or(values, |node| &values[node..=node]);
            if !self.json {
                let text: Vec<String> = chosen.iter().map(f32::to_string).collect();
                output!("{topic}  #{}  {name} {}", header.seq, text.join(" "))?;
            }
            out.insert(name.to_owned(), json!(chosen));
        }
        if self.json {
            output::json(&json!({ "topic": topic, "seq": header.seq, "node": self.node, "values": out }))?;
        }
        Ok(())
    }
}

/// Breaks a line between its parts, which two spaces separate, so that no line is wider than a terminal. Only for
/// terminals: programs get one line per sample.
fn fold(line: &str, columns: usize) -> String {
    let (mut text, mut width) = (String::new(), 0);
    for part in line.split("  ").filter(|part| !part.is_empty()) {
        let length = part.chars().count();
        match width {
            0 => width = length,
            _ if width + 2 + length > columns => {
                text += "\n    ";
                width = 4 + length;
            }
            _ => {
                text += "  ";
                width += 2 + length;
            }
        }
        text += part;
    }
    text
}

fn field_number(name: &str) -> anyhow::Result<u8> {
    field_id::from_name(name)
        .ok_or_else(|| usage(format!("--field {name}: expected x, y, z, displacement or von_mises")))
}

#[cfg(test)]
#[path = "../../tests/unit/cmd_echo.rs"]
mod tests;
