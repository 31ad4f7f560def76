//! `softtwin info`.

use crate::live::{self, DomainArgs};
use crate::output;
use serde_json::{Value, json};
use std::time::Duration;
use wire::{AnyReader, AnySample, Bus, KnownRegimes, TopicInfo, WakeSet, Wakeable, qos};

/// How long to wait for a sample to show.
const NEWEST_TIMEOUT: Duration = Duration::from_millis(300);

const EXAMPLES: &str = "\
Examples:
  softtwin info softtwin/finger/field
  softtwin info 'softtwin/finger/**' --json";

/// Everything about topics: type, writer, readers, memory, quality of service, the newest sample.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Topic or key expression.
    #[arg(value_name = "KEY")]
    key: String,
    /// One JSON object a line.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    domain: DomainArgs,
}

impl Args {
    /// Prints what is known of each topic.
    pub fn run(self) -> anyhow::Result<()> {
        let bus = self.domain.join()?;
        let mut regimes = KnownRegimes::new(&bus);
        for info in live::find(&bus, &live::key(&self.key)?)? {
            let newest = newest(&bus, &info)?;
            let regime = newest.as_ref().and_then(|sample| regimes.of(sample));
            if self.json {
                let last = newest.as_ref().map(|sample| live::json::sample(sample, regime)).transpose()?;
                output::json(&describe(&info, last.unwrap_or(Value::Null)))?;
            } else {
                print(&info, newest.as_ref(), regime)?;
            }
        }
        Ok(())
    }
}

/// The last sample of topics that keep one for late readers.
fn newest(bus: &Bus, info: &TopicInfo) -> anyhow::Result<Option<AnySample>> {
    if qos::of(info.topic.kind()).history == 0 || info.writers.is_empty() {
        return Ok(None);
    }
    let reader = AnyReader::open(bus, &info.topic)?;
    if let Some(sample) = reader.next()? {
        return Ok(Some(sample));
    }
    // The writer delivers the last sample to a new reader together with its next one.
    WakeSet::new([&reader as &dyn Wakeable]).wait(NEWEST_TIMEOUT)?;
    Ok(reader.next()?)
}

fn describe(info: &TopicInfo, last: Value) -> Value {
    let qos = qos::of(info.topic.kind());
    json!({
        "topic": info.topic.name(),
        "payload": info.payload_type,
        "header": info.header_type,
        "element_bytes": info.payload_bytes,
        "writers": info.writers,
        "readers": info.readers,
        "qos": {
            "max_readers": qos.max_readers,
            "buffer": qos.buffer,
            "max_borrowed": qos.max_borrowed,
            "history": qos.history,
            "samples_reserved": qos.samples_in_use(),
        },
        "last": last,
    })
}

fn print(info: &TopicInfo, newest: Option<&AnySample>, regime: Option<&str>) -> anyhow::Result<()> {
    let qos = qos::of(info.topic.kind());
    let list = |ids: &[u32]| match ids {
        [] => "none".to_owned(),
        ids => ids.iter().map(|id| format!("pid {id}")).collect::<Vec<_>>().join(", "),
    };
    output!("{}", info.topic.name())?;
    output!("  payload   {} ({} bytes an element)", info.payload_type, info.payload_bytes)?;
    if info.header_type.starts_with("softtwin.") {
        output!("  header    {}", info.header_type)?;
    }
    output!("  writer    {}", list(&info.writers))?;
    output!("  readers   {} (at most {})", list(&info.readers), qos.max_readers)?;
    output!(
        "  queue     newest {} wait for a reader, {} kept for late readers, {} reserved",
        qos.buffer,
        qos.history,
        qos.samples_in_use()
    )?;
    if let Some(sample) = newest {
        output!("  last      {}", live::text::sample(sample, regime))?;
    }
    Ok(())
}
