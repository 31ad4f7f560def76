//! `softtwin hz`.

use crate::live::{self, DomainArgs, Readers, SeqTracker};
use crate::output;
use runtime::twin::Histogram;
use serde_json::json;
use std::time::{Duration, Instant};
use wire::now_ns;

const EXAMPLES: &str = "\
Examples:
  softtwin hz softtwin/finger/field
  softtwin hz 'softtwin/**' --seconds 10 --json

Latency is from the reading's stamp to this program's hands.";

/// Measure rate, loss and latency of topics, second by second.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// Topic or key expression.
    #[arg(value_name = "KEY")]
    key: String,
    /// End after so many seconds.
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    /// One JSON object a line.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    domain: DomainArgs,
}

/// What one topic did in the current second.
#[derive(Default)]
struct Meter {
    count: u64,
    lost_before: u64,
    tracker: SeqTracker,
    latency: Histogram,
}

impl Args {
    /// Measures until the end that was asked for.
    pub fn run(self) -> anyhow::Result<()> {
        let limit = self.seconds.map(super::echo::seconds).transpose()?;
        let mut readers = Readers::open(&self.domain.join()?, &live::key(&self.key)?, limit)?;
        let mut meters: Vec<Meter> = readers.readers.iter().map(|_| Meter::default()).collect();
        let mut begin = Instant::now();
        loop {
            for ((_, reader), meter) in readers.readers.iter().zip(&mut meters) {
                while let Some(sample) = reader.next()? {
                    meter.count += 1;
                    meter.tracker.see(sample.boot_and_seq());
                    if let Some(t_sensor_ns) = sample.t_sensor_ns() {
                        meter.latency.add(now_ns().saturating_sub(t_sensor_ns));
                    }
                }
            }
            let elapsed = begin.elapsed();
            let rest = Duration::from_secs(1).saturating_sub(elapsed);
            if rest.is_zero() {
                for ((topic, _), meter) in readers.readers.iter().zip(&mut meters) {
                    self.show(topic.name(), meter, elapsed)?;
                }
                begin = Instant::now();
            }
            if !readers.wait(rest.max(Duration::from_millis(1)))? {
                break;
            }
        }
        let elapsed = begin.elapsed();
        if elapsed > Duration::from_millis(100) {
            for ((topic, _), meter) in readers.readers.iter().zip(&mut meters) {
                self.show(topic.name(), meter, elapsed)?;
            }
        }
        Ok(())
    }

    fn show(&self, topic: &str, meter: &mut Meter, elapsed: Duration) -> anyhow::Result<()> {
        let rate_hz = meter.count as f64 / elapsed.as_secs_f64();
        let lost = meter.tracker.lost - std::mem::replace(&mut meter.lost_before, meter.tracker.lost);
        let us = |share| meter.latency.quantile(share) as f64 / 1000.0;
        let (p50, p99, max) = (us(0.5), us(0.99), meter.latency.max() as f64 / 1000.0);
        if self.json {
            let latency = json!({ "p50": p50, "p99": p99, "max": max });
            output::json(
                &json!({ "topic": topic, "rate_hz": rate_hz, "lost": lost, "latency_us": latency }),
            )?;
        } else if meter.latency.total() == 0 {
            output!("{topic}  {rate_hz:8.1} Hz  {lost} lost")?;
        } else {
            output!(
                "{topic}  {rate_hz:8.1} Hz  {lost} lost  latency p50 {p50:.1} p99 {p99:.1} max {max:.1} us"
            )?;
        }
        meter.count = 0;
        meter.latency.clear();
        Ok(())
    }
}
