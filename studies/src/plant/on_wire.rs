//! `softtwin-studies plant`: a simulated actuator in shared memory: takes pressure commands and setpoints, publishes readings,
//! prints the step response of its true force at the end.

use super::Truth;
use super::report::{percentiles, step_response};
use anyhow::Context;
use control::plant::{Plant, PlantSpec};
use rom::memory::Line;
use runtime::config::Scene;
use runtime::query::Answerer;
use serde_json::json;
use softtwin::output;
use std::path::PathBuf;
use std::time::{Duration, Instant};
use wire::{
    Bus, CommandReader, Domain, SensorSample, SensorWriter, SetpointReader, Topic, WakeSet, Wakeable,
    boot_id, now_ns,
};

/// Simulated actuator: commands in, readings out, and the truth at the end.
#[derive(clap::Args)]
#[command(before_help = "Example, three terminals:\n  softtwind twin --scene config/scenes/force.toml\n  \
    softtwin-studies plant --scene config/scenes/force.toml --true-gap-mm 33 --target-n 0.3\n  softtwin hold --scene config/scenes/force.toml --force-n 0.3")]
pub struct Args {
    /// Scene whose first actuator this is; its model gives the true force.
    #[arg(long, value_name = "FILE")]
    scene: PathBuf,
    /// The gap that really is there, mm.
    #[arg(long, value_name = "MM", default_value_t = 33.0)]
    true_gap_mm: f64,
    /// The gap at the gap sensor, mm, which all other programs assume.
    #[arg(long, value_name = "MM", default_value_t = 30.0)]
    shown_gap_mm: f64,
    /// The force that the controller is to hold, N: only for the report.
    #[arg(long, value_name = "N", default_value_t = 0.3)]
    target_n: f64,
    /// Readings a second.
    #[arg(long, value_name = "HZ", default_value_t = 500.0)]
    rate_hz: f64,
    /// Seconds of simulation after the first command.
    #[arg(long, value_name = "S", default_value_t = 5.0)]
    seconds: f64,
    /// Time constant of the pneumatics, s.
    #[arg(long, value_name = "S", default_value_t = 0.08)]
    tau_s: f64,
    /// Time from command to valve, s.
    #[arg(long, value_name = "S", default_value_t = 0.02)]
    delay_s: f64,
    /// No load cell: the readings carry no measured force.
    #[arg(long)]
    no_load_cell: bool,
    /// Seed of the noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

impl Args {
    /// Runs the plant until `seconds` after the first command, or a signal.
    pub fn run(self) -> anyhow::Result<()> {
        let scene = Scene::load(&self.scene)?;
        let spec = scene.actuators.first().context("the scene has no actuator")?;
        let answerer =
            Answerer::load(spec, &spec.model).map_err(|found| anyhow::anyhow!(found.join("\n")))?;
        let plant = PlantSpec {
            valve_s: 0.0,
            line: Line { fill_s: self.tau_s, empty_s: self.tau_s },
            delay_s: self.delay_s,
            supply_mpa: spec.valve.as_ref().map_or(0.09, |valve| valve.range_mpa[1]),
            true_gap_mm: self.true_gap_mm,
            seed: self.seed,
            ..PlantSpec::default()
        };
        let mut plant = Plant::new(plant, Truth::Model(Box::new(answerer.into_solver())));
        let bus = Bus::open(&Domain::from_env())?;
        let commands = CommandReader::attach(&bus, &Topic::command(&spec.name)?)?;
        let setpoints = SetpointReader::attach(&bus, &Topic::setpoint(&spec.name)?)?;
        let mut sensor = SensorWriter::create(&bus, &Topic::sensor(&spec.name)?)?;
        let mut wake = WakeSet::new([&commands as &dyn Wakeable, &setpoints]);
        eprint_ready(&spec.name);

        let (boot_id, period) = (boot_id(), Duration::from_secs_f64(1.0 / self.rate_hz));
        let (mut seq, mut first_command, mut points, mut latencies_ns) = (0, None, Vec::new(), Vec::new());
        let (mut last, mut due) = (Instant::now(), Instant::now());
        let stop = runtime::service::stop_flag().context("cannot listen for signals")?;
        while !stop.load(std::sync::atomic::Ordering::Relaxed) {
            // Commands are taken when they come, not when the next reading is due: the delay is the plant's, not ours.
            loop {
                let mut take = |t_sensor_ns: u64, pressure_mpa: f64| {
                    if t_sensor_ns != 0 {
                        latencies_ns.push(now_ns().saturating_sub(t_sensor_ns));
                    }
                    first_command.get_or_insert_with(Instant::now);
                    plant.command(pressure_mpa);
                };
                while let Some(command) = commands.next()? {
                    take(command.t_sensor_ns, command.pressure_mpa);
                }
                while let Some(setpoint) = setpoints.next()? {
                    // Released: the pressure is let off.
                    let is_wanted = setpoint.pressure_mpa.is_finite();
                    take(setpoint.t_sensor_ns, if is_wanted { setpoint.pressure_mpa } else { 0.0 });
                }
                let left = due.saturating_duration_since(Instant::now());
                if left.is_zero() {
                    break;
                }
                wake.wait(left)?;
            }
            due = (due + period).max(Instant::now());
            let now = Instant::now();
            let reading = plant.step(now.duration_since(last).as_secs_f64());
            last = now;
            seq += 1;
            sensor.publish(SensorSample {
                boot_id,
                seq,
                t_sensor_ns: now_ns(),
                pressure_mpa: reading.pressure_mpa,
                gap_mm: self.shown_gap_mm,
                measured_force_n: if self.no_load_cell { f64::NAN } else { reading.force_n },
                ..SensorSample::default()
            })?;
            if let Some(first) = first_command {
                let elapsed_s = first.elapsed().as_secs_f64();
                points.push((elapsed_s, reading.true_force_n));
                if elapsed_s > self.seconds {
                    break;
                }
            }
        }
        let report = json!({
            "readings": seq,
            "commands": latencies_ns.len(),
            "true_gap_mm": self.true_gap_mm,
            "shown_gap_mm": self.shown_gap_mm,
            "response": step_response(self.target_n, &points),
            "reading_to_command": percentiles(&mut latencies_ns),
        });
        output::json(&report)
    }
}

/// The line that scripts wait for.
fn eprint_ready(actuator: &str) {
    use std::io::Write;
    // A closed error stream is no reason to stop a plant.
    let _ = writeln!(std::io::stderr(), "ready: plant of {actuator}");
}
