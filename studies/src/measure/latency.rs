//! Reads states or fields as they come, or asks what-ifs, and prints latencies as one JSON object; the Python and C clients
//! have the same program.

use crate::plant::report::percentiles;
use serde_json::json;
use softtwin::output;
use std::time::{Duration, Instant};
use wire::layout::query_kind;
use wire::{Bus, Domain, FieldReader, Query, QueryClient, StateReader, Topic, WakeSet, Wakeable, now_ns};

/// Latency from publish to here, woken by event.
#[derive(clap::Args)]
#[command(
    before_help = "Examples:\n  softtwin-studies measure latency field --seconds 60\n  softtwin-studies measure latency state --actuator left\n  softtwin-studies measure latency whatif --seconds 10"
)]
pub struct Args {
    /// `state`, `field`, or `whatif` (questions, one after the other).
    what: String,
    /// Actuator.
    #[arg(long, default_value = "finger")]
    actuator: String,
    /// Node set of the field.
    #[arg(long)]
    node_set: Option<String>,
    /// Seconds.
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    seconds: f64,
    /// Pause between questions, us.
    #[arg(long, value_name = "US", default_value_t = 1000)]
    pause_us: u64,
}

impl Args {
    /// Measures and prints.
    pub fn run(self) -> anyhow::Result<()> {
        let bus = Bus::open(&Domain::from_env())?;
        let (mut latencies_ns, lost) = match self.what.as_str() {
            "state" => states(&bus, &self)?,
            "field" => fields(&bus, &self)?,
            "whatif" => (questions(&bus, &self)?, 0),
            other => anyhow::bail!("`{other}`: expected state, field or whatif"),
        };
        let report = json!({ "what": self.what, "lost": lost, "latency": percentiles(&mut latencies_ns) });
        output::json(&report)
    }
}

fn states(bus: &Bus, args: &Args) -> anyhow::Result<(Vec<u64>, u64)> {
    let reader = StateReader::open(bus, &Topic::state(&args.actuator)?)?;
    let seen = || Ok(reader.next()?.map(|state| (state.boot_id, state.seq, state.t_publish_ns)));
    listen(&reader, args, seen)
}

fn fields(bus: &Bus, args: &Args) -> anyhow::Result<(Vec<u64>, u64)> {
    let reader = FieldReader::open(bus, &Topic::field(&args.actuator, args.node_set.as_deref())?)?;
    let seen = || {
        let sample = reader.next()?;
        // Reads the last value, so that the sample is in memory.
        Ok(sample.filter(|sample| sample.values().last().is_some_and(|value| value.is_finite())).map(
            |sample| {
                let header = sample.header();
                (header.boot_id, header.seq, header.t_publish_ns)
            },
        ))
    };
    listen(&reader, args, seen)
}

/// Latencies of all samples that come, and how many were lost.
fn listen(
    reader: &dyn Wakeable,
    args: &Args,
    next: impl Fn() -> anyhow::Result<Option<(u64, u64, u64)>>,
) -> anyhow::Result<(Vec<u64>, u64)> {
    let mut wait = WakeSet::new([reader]);
    let (mut latencies_ns, mut lost, mut last) = (Vec::new(), 0, None);
    while next()?.is_some() {} // what was sent before we listened says nothing
    let begin = Instant::now();
    while begin.elapsed().as_secs_f64() < args.seconds {
        wait.wait(Duration::from_millis(100))?;
        while let Some((boot_id, seq, t_publish_ns)) = next()? {
            latencies_ns.push(now_ns().saturating_sub(t_publish_ns));
            if let Some((last_boot, last_seq)) = last
                && last_boot == boot_id
            {
                lost += seq - last_seq - 1;
            }
            last = Some((boot_id, seq));
        }
    }
    Ok((latencies_ns, lost))
}

fn questions(bus: &Bus, args: &Args) -> anyhow::Result<Vec<u64>> {
    let mut client = QueryClient::open(bus, &args.actuator)?;
    let (begin, mut latencies_ns, mut number) = (Instant::now(), Vec::new(), 0_u32);
    while begin.elapsed().as_secs_f64() < args.seconds {
        number = (number + 1) % 80;
        let pressure_mpa = 0.005 + 0.001 * f64::from(number);
        let query = Query { kind: query_kind::WHATIF, pressure_mpa, gap_mm: 30.0, ..Query::default() };
        let asked = Instant::now();
        let sample = client.ask(&query, Duration::from_secs(1))?;
        latencies_ns.push(asked.elapsed().as_nanos() as u64);
        anyhow::ensure!(sample.answer().pressure_mpa == pressure_mpa, "an answer to another question");
        std::thread::sleep(Duration::from_micros(args.pause_us));
    }
    Ok(latencies_ns)
}
