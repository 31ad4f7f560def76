//! `softtwin list`.

use crate::live::{self, DomainArgs};
use crate::output;
use serde_json::json;
use wire::TopicInfo;

const EXAMPLES: &str = "\
Examples:
  softtwin list
  softtwin list 'softtwin/*/state'
  softtwin list --json | jq -r '.[].topic'

Key expressions are Zenoh's: `*` is one chunk, `**` any number, `$*` any part of a chunk. Quote them for the shell.";

/// List the topics of the domain: what is there, who writes, who reads.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Key expression.
    #[arg(value_name = "KEY", default_value = "softtwin/**")]
    key: String,
    /// One JSON array instead of a table.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    domain: DomainArgs,
}

impl Args {
    /// Lists and ends.
    pub fn run(self) -> anyhow::Result<()> {
        let key = live::key(&self.key)?;
        let topics = live::find(&self.domain.join()?, &key)?;
        if self.json {
            let rows: Vec<_> = topics.iter().map(row_json).collect();
            return output::json(&rows);
        }
        let width = topics.iter().map(|info| info.topic.name().len()).max().unwrap_or(0).max(5);
        output!("{:width$}  {:24}  {:>8}  {:>7}", "TOPIC", "TYPE", "WRITER", "READERS")?;
        for info in &topics {
            let writer = info.writers.first().map_or("none".to_owned(), |pid| format!("pid {pid}"));
            output!(
                "{:width$}  {:24}  {writer:>8}  {:>7}",
                info.topic.name(),
                type_of(info),
                info.readers.len()
            )?;
        }
        Ok(())
    }
}

fn type_of(info: &TopicInfo) -> &str {
    if info.header_type.starts_with("softtwin.") { &info.header_type } else { &info.payload_type }
}

fn row_json(info: &TopicInfo) -> serde_json::Value {
    json!({
        "topic": info.topic.name(),
        "type": type_of(info),
        "writers": info.writers,
        "readers": info.readers,
    })
}
