//! Holds a contact force by commanding pressure: reads the twin's state, asks it for the inverse, sends commands.
#![forbid(unsafe_code)]

use clap::Parser;
use examples::control::{Controller, Gains};
use examples::report::{percentiles, step_response};
use serde_json::json;
use std::io::Write;
use std::time::{Duration, Instant};
use wire::layout::{flags, query_kind};
use wire::{
    Bus, Command, CommandWriter, Domain, Query, QueryClient, StateReader, Topic, Wake, WakeSet, Wakeable,
    boot_id, now_ns,
};

/// Controller: holds a contact force.
#[derive(Debug, Parser)]
#[command(name = "softtwin-hold-force", after_help = "See softtwin-plant --help for the whole example.")]
struct Args {
    /// Actuator.
    #[arg(long, default_value = "finger")]
    actuator: String,
    /// Force to hold, N.
    #[arg(long, value_name = "N", default_value_t = 0.3)]
    target_n: f64,
    /// Gap that is assumed until the twin's state shows one, mm.
    #[arg(long, value_name = "MM", default_value_t = 30.0)]
    gap_mm: f64,
    /// Ends after so many seconds, or when nothing comes for one second.
    #[arg(long, value_name = "S", default_value_t = 60.0)]
    seconds: f64,
}

/// A state older than this, or none: the pressure is let off.
const SILENCE: Duration = Duration::from_secs(1);

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let bus = Bus::open(&Domain::from_env())?;
    let states = StateReader::open(&bus, &Topic::state(&args.actuator)?)?;
    let inverse =
        Query { kind: query_kind::PRESSURE, force_n: args.target_n, gap_mm: args.gap_mm, ..Query::default() };
    let sample = QueryClient::open(&bus, &args.actuator)?.ask(&inverse, Duration::from_secs(1))?;
    if let Some(reason) = sample.answer().refusal() {
        anyhow::bail!("{} N cannot be held at {} mm: {reason}", args.target_n, args.gap_mm);
    }
    let feed_forward_mpa = sample.answer().pressure_mpa;
    let mut controller = Controller::new(Gains::default(), args.target_n, feed_forward_mpa);
    let mut valve = CommandWriter::create(&bus, &Topic::command(&args.actuator)?)?;
    let mut wake = WakeSet::new([&states as &dyn Wakeable]);

    let (boot_id, begin) = (boot_id(), Instant::now());
    let (mut seq, mut last, mut points, mut turns_ns) = (0, None, Vec::new(), Vec::new());
    let mut send = |pressure_mpa: f64, t_sensor_ns: u64| {
        seq += 1;
        valve.publish(Command {
            boot_id,
            seq,
            t_sensor_ns,
            t_publish_ns: now_ns(),
            pressure_mpa,
            reserved: 0,
        })
    };
    while begin.elapsed().as_secs_f64() < args.seconds {
        let Some(state) = states.newest()? else {
            if wake.wait(SILENCE)? == Wake::Timeout {
                break;
            }
            continue;
        };
        if state.flags & (flags::NO_DATA | flags::STALE | flags::HELD) != 0 {
            // What stands in for a reading is not acted on; the plant's end shows itself as silence of good readings.
            if state.age_ns > SILENCE.as_nanos() as u64 {
                break;
            }
            continue;
        }
        let dt_s = last.map_or(0.0, |before| state.t_sensor_ns.saturating_sub(before) as f64 * 1e-9).min(0.1);
        last = Some(state.t_sensor_ns);
        // The load cell where there is one, the twin's own estimate otherwise.
        let force_n =
            if state.measured_force_n.is_finite() { state.measured_force_n } else { state.contact_force_n };
        let command = controller.update(force_n, state.force_by_pressure_n_per_mpa, dt_s);
        send(command, state.t_sensor_ns)?;
        turns_ns.push(now_ns().saturating_sub(state.t_sensor_ns));
        points.push((begin.elapsed().as_secs_f64(), force_n));
    }
    send(0.0, 0)?; // the pressure is let off, whatever ended it
    let report = json!({
        "feed_forward_mpa": feed_forward_mpa,
        "measured_response": step_response(args.target_n, &points),
        "reading_to_command_sent": percentiles(&mut turns_ns),
    });
    writeln!(std::io::stdout(), "{report}")?;
    Ok(())
}
