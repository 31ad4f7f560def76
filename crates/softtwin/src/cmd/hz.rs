//! `softtwin hz`.

use crate::live::{self, DomainArgs, Latencies, PercentilesUs, Readers};
use crate::output;
use recording::{Gap, GapCounter};
use serde_json::json;
use std::time::{Duration, Instant};
use wire::layout::flags;
use wire::{AnySample, now_ns};

const EXAMPLES: &str = "\
Examples:
  softtwin hz softtwin/finger/field
  softtwin hz 'softtwin/**' --seconds 10 --json

Latency is the time from the reading's stamp until this program has received the sample.";

/// Measure rate, loss and latency of topics, second by second.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Topic or key expression.
    #[arg(value_name = "KEY")]
    key: String,
    /// End after so many seconds.
    #[arg(long, value_name = "S", value_parser = crate::range::seconds)]
    seconds: Option<f64>,
    /// One JSON object a line.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    domain: DomainArgs,
}

/// What one topic did in the current second.
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
        let lost = self.gaps.observe(sample.stamp()).map_or(0, Gap::missing);
        self.lost = self.lost.saturating_add(lost);
        if let Some(t_sensor_ns) = reading_time_ns(sample) {
            self.latencies.record_ns(now_ns().saturating_sub(t_sensor_ns));
        }
    }
}

/// When the reading behind a sample was taken; none for health, and for a state that stands in for a missing reading.
fn reading_time_ns(sample: &AnySample) -> Option<u64> {
    let bits = match sample {
        AnySample::State(state) => state.flags,
        AnySample::Grasp(grasp) => grasp.flags,
        _ => 0,
    };
    let is_fresh = bits & (flags::STALE | flags::HELD | flags::NO_DATA) == 0;
    Some(sample.stamp().t_sensor_ns).filter(|t_sensor_ns| is_fresh && *t_sensor_ns != 0)
}

impl Args {
    /// Measures until the end that the arguments name.
    pub fn run(self) -> anyhow::Result<()> {
        let limit = self.seconds.map(Duration::from_secs_f64);
        let mut readers = Readers::open(&self.domain.join()?, &live::key(&self.key)?, limit)?;
        let names = readers.topics().map(|topic| Ok((topic.name().to_owned(), Meter::new()?)));
        let mut meters = names.collect::<anyhow::Result<Vec<(String, Meter)>>>()?;
        let mut begin = Instant::now();
        let mut goes_on = true;
        while goes_on {
            while let Some((index, sample)) = readers.next()? {
                meters[index].1.record(&sample);
            }
            let rest = Duration::from_secs(1).saturating_sub(begin.elapsed());
            goes_on = readers.wait(rest.max(Duration::from_millis(1)))?;
            let elapsed = begin.elapsed();
            let is_worth_showing = elapsed > Duration::from_millis(100);
            if elapsed >= Duration::from_secs(1) || (!goes_on && is_worth_showing) {
                for (topic, meter) in &mut meters {
                    self.show(topic, meter, elapsed)?;
                }
                begin = Instant::now();
            }
        }
        Ok(())
    }

    fn show(&self, topic: &str, meter: &mut Meter, elapsed: Duration) -> anyhow::Result<()> {
        let rate_hz = meter.count as f64 / elapsed.as_secs_f64();
        let lost = std::mem::take(&mut meter.lost);
        let latency = meter.latencies.percentiles_us();
        if self.json {
            output::json(
                &json!({ "topic": topic, "rate_hz": rate_hz, "lost": lost, "latency_us": latency }),
            )?;
        } else {
            let PercentilesUs { p50, p99, max } = latency;
            let latency = match meter.latencies.is_empty() {
                true => String::new(),
                false => format!("  latency p50 {p50:.1} p99 {p99:.1} max {max:.1} us"),
            };
            output!("{topic}  {rate_hz:8.1} Hz  {lost} lost{latency}")?;
        }
        meter.count = 0;
        meter.latencies.clear();
        Ok(())
    }
}
