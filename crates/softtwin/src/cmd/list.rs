//! `softtwin list`.

use crate::live::{self, DomainArgs, Latencies, PercentilesUs, Readers};
use crate::output;
use recording::GapCounter;
use serde_json::{Value, json};
use std::time::{Duration, Instant};
use wire::layout::flags;
use wire::{AnyReader, AnySample, Bus, TopicInfo, WakeSet, Wakeable, now_ns, qos};

/// Longest wait for the newest sample of a topic.
const NEWEST_TIMEOUT: Duration = Duration::from_millis(300);

const EXAMPLES: &str = "\
Examples:
  softtwin list
  softtwin list 'softtwin/*/state' --long
  softtwin list softtwin/finger/field --rate
  softtwin list --rate --seconds 10 --json
  softtwin list --json | jq -r '.[].topic'

Key expressions are Zenoh's: `*` is one chunk, `**` any number, `$*` any part of a chunk. Quote them for the shell. \
Latency is the time from the reading's stamp until this program has received the sample.";

/// List the topics in shared memory with writers and readers; on request details, or rate, loss and latency.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Key expression.
    #[arg(value_name = "KEY", default_value = "softtwin/**")]
    key: String,
    /// Add memory, quality of service and the newest sample of each topic.
    #[arg(long, conflicts_with = "rate")]
    long: bool,
    /// Measure rate, loss and latency instead, one line per topic and second, until Ctrl-C.
    #[arg(long)]
    rate: bool,
    /// End --rate after this number of seconds.
    #[arg(long, value_name = "S", requires = "rate", value_parser = crate::range::seconds)]
    seconds: Option<f64>,
    /// One JSON array instead of a table; with --rate one JSON object per line.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    domain: DomainArgs,
}

impl Args {
    /// Lists or measures the topics.
    pub fn run(self) -> anyhow::Result<()> {
        let key = live::key(&self.key)?;
        let bus = self.domain.join()?;
        if self.rate {
            let limit = self.seconds.map(Duration::from_secs_f64);
            return self.measure(Readers::open(&bus, &key, limit)?);
        }
        if bus.names(&live::key("softtwin/**")?)?.is_empty() {
            tracing::warn!("{}", live::NO_TOPIC);
            return if self.json { output::json(&Vec::<()>::new()) } else { Ok(()) };
        }
        let topics = live::find(&bus, &key)?;
        match (self.json, self.long) {
            (true, false) => output::json(&topics.iter().map(row).collect::<Vec<_>>()),
            (false, false) => table(&topics),
            (_, true) => self.describe(&bus, &topics),
        }
    }

    fn describe(&self, bus: &Bus, topics: &[TopicInfo]) -> anyhow::Result<()> {
        let mut rows = Vec::new();
        for info in topics {
            let newest = newest(bus, info)?;
            if self.json {
                let last = newest.as_ref().map(live::sample_json).transpose()?;
                rows.push(long_row(info, last));
            } else {
                print(info, newest.as_ref().map(live::text::sample))?;
            }
        }
        if self.json { output::json(&rows) } else { Ok(()) }
    }

    fn measure(&self, mut readers: Readers) -> anyhow::Result<()> {
        let names = readers.topics().map(|topic| Ok((topic.name().to_owned(), Meter::new()?)));
        let mut meters = names.collect::<anyhow::Result<Vec<(String, Meter)>>>()?;
        let mut begin = Instant::now();
        let mut is_running = true;
        while is_running {
            while let Some((index, sample)) = readers.next()? {
                meters[index].1.record(&sample);
            }
            let rest = Duration::from_secs(1).saturating_sub(begin.elapsed());
            is_running = readers.wait(rest.max(Duration::from_millis(1)))?;
            let elapsed = begin.elapsed();
            let is_worth_showing = elapsed > Duration::from_millis(100);
            if elapsed >= Duration::from_secs(1) || (!is_running && is_worth_showing) {
                for (topic, meter) in &mut meters {
                    meter.show(topic, elapsed, self.json)?;
                }
                begin = Instant::now();
            }
        }
        Ok(())
    }
}

fn type_of(info: &TopicInfo) -> &str {
    if info.header_type.starts_with("softtwin.") { &info.header_type } else { &info.payload_type }
}

fn table(topics: &[TopicInfo]) -> anyhow::Result<()> {
    let width = topics.iter().map(|info| info.topic.name().len()).max().unwrap_or(0).max(5);
    output!("{:width$}  {:24}  {:>8}  {:>7}", "TOPIC", "TYPE", "WRITER", "READERS")?;
    for info in topics {
        let writer = info.writers.first().map_or("none".to_owned(), |pid| format!("pid {pid}"));
        let (name, readers) = (info.topic.name(), info.readers.len());
        output!("{name:width$}  {:24}  {writer:>8}  {readers:>7}", type_of(info))?;
    }
    Ok(())
}

fn row(info: &TopicInfo) -> Value {
    json!({
        "topic": info.topic.name(),
        "type": type_of(info),
        "writers": info.writers,
        "readers": info.readers,
    })
}

fn long_row(info: &TopicInfo, last: Option<Value>) -> Value {
    let qos = qos::of(info.topic.kind());
    let mut row = row(info);
    row["payload"] = json!(info.payload_type);
    row["header"] = json!(info.header_type);
    row["element_bytes"] = json!(info.payload_bytes);
    row["qos"] = json!({
        "max_readers": qos.max_readers,
        "buffer": qos.buffer,
        "max_borrowed": qos.max_borrowed,
        "history": qos.history,
        "samples_reserved": qos.samples_in_use(),
    });
    row["last"] = json!(last);
    row
}

fn print(info: &TopicInfo, newest: Option<String>) -> anyhow::Result<()> {
    let qos = qos::of(info.topic.kind());
    let list = |ids: &[u32]| match ids {
        [] => "none".to_owned(),
        ids => ids.iter().map(|id| format!("pid {id}")).collect::<Vec<_>>().join(", "),
    };
    output!("{}", info.topic.name())?;
    output!("  payload   {} ({} bytes per element)", info.payload_type, info.payload_bytes)?;
    if info.header_type.starts_with("softtwin.") {
        output!("  header    {}", info.header_type)?;
    }
    output!("  writer    {}", list(&info.writers))?;
    output!("  readers   {} (at most {})", list(&info.readers), qos.max_readers)?;
    output!(
        "  queue     {} per reader, {} kept for late readers, {} reserved",
        qos.buffer,
        qos.history,
        qos.samples_in_use()
    )?;
    newest.map_or(Ok(()), |newest| Ok(output!("  last      {newest}")?))
}

/// Last sample of a topic that keeps one for late readers.
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

/// Counts and latencies of one topic in the current second.
struct Meter {
    count: u64,
    lost: u64,
    gaps: GapCounter,
    latencies: Latencies,
}

impl Meter {
    fn new() -> anyhow::Result<Self> {
        Ok(Self { count: 0, lost: 0, gaps: GapCounter::default(), latencies: Latencies::new()? })
    }

    fn record(&mut self, sample: &AnySample) {
        self.count += 1;
        self.lost = self.lost.saturating_add_signed(self.gaps.observe(sample.stamp()).missing);
        if let Some(t_sensor_ns) = reading_time_ns(sample) {
            self.latencies.record_ns(now_ns().saturating_sub(t_sensor_ns));
        }
    }

    /// Prints one line and resets the counts.
    fn show(&mut self, topic: &str, elapsed: Duration, json: bool) -> anyhow::Result<()> {
        let rate_hz = self.count as f64 / elapsed.as_secs_f64();
        let lost = std::mem::take(&mut self.lost);
        let latency = self.latencies.percentiles_us();
        if json {
            output::json(
                &json!({ "topic": topic, "rate_hz": rate_hz, "lost": lost, "latency_us": latency }),
            )?;
        } else {
            let PercentilesUs { p50, p99, max } = latency;
            let latency = match self.latencies.is_empty() {
                true => String::new(),
                false => format!("  latency p50 {p50:.1} p99 {p99:.1} max {max:.1} us"),
            };
            output!("{topic}  {rate_hz:8.1} Hz  {lost} lost{latency}")?;
        }
        self.count = 0;
        self.latencies.clear();
        Ok(())
    }
}

/// Time of the reading behind a sample; `None` for health, and for a state that replaces a missing reading.
fn reading_time_ns(sample: &AnySample) -> Option<u64> {
    let bits = match sample {
        AnySample::State(state) => state.flags,
        AnySample::Grasp(grasp) => grasp.flags,
        _ => 0,
    };
    let is_fresh = bits & (flags::STALE | flags::HELD | flags::NO_DATA) == 0;
    Some(sample.stamp().t_sensor_ns).filter(|t_sensor_ns| is_fresh && *t_sensor_ns != 0)
}
