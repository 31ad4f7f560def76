//! `softtwin list`.

use crate::live::{self, DomainArgs, Latencies, PercentilesUs, Readers};
use crate::{output, report};
use recording::GapCounter;
use serde::Serialize;
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
        if self.long {
            let long =
                topics.iter().map(|info| LongRow::of(&bus, info)).collect::<anyhow::Result<Vec<_>>>()?;
            return report::print(&long, self.json);
        }
        report::print(&topics.iter().map(TopicRow::of).collect::<Vec<_>>(), self.json)
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

/// A topic with the processes at its ends.
#[derive(Serialize)]
struct TopicRow<'a> {
    topic: &'a str,
    #[serde(rename = "type")]
    type_name: &'a str,
    writers: &'a [u32],
    readers: &'a [u32],
}

impl<'a> TopicRow<'a> {
    fn of(info: &'a TopicInfo) -> Self {
        Self {
            topic: info.topic.name(),
            type_name: type_of(info),
            writers: &info.writers,
            readers: &info.readers,
        }
    }
}

#[derive(Serialize)]
struct LongRow<'a> {
    #[serde(flatten)]
    row: TopicRow<'a>,
    payload: &'a str,
    header: &'a str,
    element_bytes: usize,
    qos: Value,
    last: Option<Value>,
}

impl<'a> LongRow<'a> {
    fn of(bus: &Bus, info: &'a TopicInfo) -> anyhow::Result<Self> {
        let qos = qos::of(info.topic.kind());
        Ok(Self {
            row: TopicRow::of(info),
            payload: &info.payload_type,
            header: &info.header_type,
            element_bytes: info.payload_bytes,
            qos: json!({
                "max_readers": qos.max_readers,
                "buffer": qos.buffer,
                "max_borrowed": qos.max_borrowed,
                "history": qos.history,
                "samples_reserved": qos.samples_in_use(),
            }),
            last: newest(bus, info)?.as_ref().map(live::sample_json).transpose()?,
        })
    }
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
        Ok(Self { count: 0, lost: 0, gaps: GapCounter::default(), latencies: Latencies::new() })
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
