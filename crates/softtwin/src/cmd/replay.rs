//! `softtwin replay`: a recording or a trace back onto the wire, as a bridge would.

use crate::failure::{configuration, usage};
use crate::live::DomainArgs;
use crate::{files, output, report};
use anyhow::{Result, anyhow};
use formats::log::Mapping;
use runtime::bridge::{Bridge, BridgeCounters};
use runtime::source::{InputNames, Poll, Reading, ReplaySpec, Source, SourceSpec, in_another_unit};
use serde_json::json;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use wire::layout::PARAMETERS_MAX;
use wire::{Bus, SensorSample, SensorWriter, Topic, boot_id, now_ns};

const EXAMPLES: &str = "\
Examples:
  In the recorded order and time, to the twin of the actuator `finger`:
    softtwin replay run.mcap --actuator finger
  Seconds 10 to 20, ten times as fast, repeated:
    softtwin replay run.mcap --actuator finger --from-s 10 --to-s 20 \\
      --speed 10 --loop
  One reading each time Enter is pressed:
    softtwin replay config/traces/gap40.csv --actuator finger --step
  A trace of the inputs of a model without a pressure (columns t_s, load_n):
    softtwin replay load.csv --actuator part
  All files of a recorder that rotates, as one recording:
    softtwin replay /var/lib/softtwin --actuator finger
  A table of a bench, with the mapping of its columns (softtwin inspect):
    softtwin replay run1.csv --log log.toml --actuator finger
  A recording of two actuators: say which one:
    softtwin replay run.mcap --actuator left --topic softtwin/left/sensor

A running bridge of the same actuator must be stopped first: there is one sensor for an actuator.";

/// Comments and header of a trace lie within this number of bytes.
const HEADER_BYTES: u64 = 1 << 16;

/// Play readings of a recording (MCAP) or a trace (CSV) to a twin.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Recording (a file, or a folder of rotated files) or trace
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Actuator whose sensor to be
    #[arg(long, value_name = "NAME", help_heading = "Selection")]
    actuator: String,
    /// Mapping of the columns of a bench's table
    #[arg(long, value_name = "FILE.toml", conflicts_with = "topic")]
    log: Option<PathBuf>,
    /// Sensor topic of a recording that holds several
    #[arg(long, value_name = "TOPIC")]
    topic: Option<String>,
    /// Factor on the speed
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = crate::range::number(1e-6, 1e9))]
    speed: f64,
    /// Begin at this time of the recording
    #[arg(long, value_name = "SECONDS", default_value_t = -1e12, hide_default_value = true, value_parser = crate::range::number(-1e12, 1e12), help_heading = "Selection")]
    from_s: f64,
    /// End at this time of the recording
    #[arg(long, value_name = "SECONDS", default_value_t = 1e12, hide_default_value = true, value_parser = crate::range::number(-1e12, 1e12), help_heading = "Selection")]
    to_s: f64,
    /// Repeat until stopped
    #[arg(long = "loop", help_heading = "Computing")]
    repeat: bool,
    /// Send one reading for each line on standard input, whatever it says
    #[arg(long, conflicts_with_all = ["speed", "repeat"])]
    step: bool,
    /// End with one JSON object
    #[arg(long, help_heading = "Output")]
    json: bool,
    #[command(flatten)]
    domain: DomainArgs,
}

impl Args {
    /// Plays until the end, a signal, or the end of standard input when stepping.
    ///
    /// # Errors
    /// A file that is no trace, options that leave nothing of it, another bridge for this actuator.
    pub fn run(self) -> Result<()> {
        let topic = Topic::sensor(&self.actuator).map_err(usage)?;
        let spec = ReplaySpec {
            trace: self.file.clone(),
            log: self.log.clone(),
            topic: self.topic.clone(),
            speed: self.speed,
            repeat: self.repeat,
            from_s: self.from_s,
            to_s: self.to_s,
        };
        let inputs = match &self.log {
            Some(log) => mapped_inputs(log)?,
            None => inputs(&self.file)?,
        };
        let source = SourceSpec::Replay(spec)
            .open(Path::new(""), &inputs)
            .map_err(|problems| configuration(anyhow!("{}", problems.join("\n  "))))?;
        let stop = runtime::service::stop_flag()?;
        let bus = self.domain.join()?;
        let sent = if self.step {
            step(&bus, &topic, source, &inputs, &stop)?
        } else {
            self.play(&bus, source, &stop)?
        };
        report::print(&json!({"sent": sent}), self.json)
    }

    fn play(&self, bus: &Bus, source: Box<dyn Source>, stop: &AtomicBool) -> Result<u64> {
        let mut bridge = Bridge::start(bus, vec![(self.actuator.clone(), source)])?;
        let counters = BridgeCounters::default();
        bridge.run(stop, &counters)?;
        let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        let failed = count(&counters.failed);
        anyhow::ensure!(failed == 0, "{failed} readings could not be sent");
        Ok(count(&counters.sent))
    }
}

/// The inputs of a mapping that no reading has by itself.
fn mapped_inputs(log: &Path) -> Result<InputNames> {
    let mapping = Mapping::read(log).map_err(files::refusal)?;
    let names = mapping.input.iter().map(|channel| channel.name.as_str());
    let names: Vec<&str> =
        names.filter(|name| !["pressure_mpa", "gap_mm", "measured_force_n"].contains(name)).collect();
    if names.len() > PARAMETERS_MAX {
        return Err(configuration(anyhow!(
            "{}: expected at most {PARAMETERS_MAX} inputs besides pressure and gap, found {}",
            log.display(),
            names.len()
        )));
    }
    Ok(InputNames::new(names))
}

/// The model inputs among the columns of a trace: without a pressure, all that no reading has by itself. `None` if it is a recording,
/// whose readings have their own.
fn inputs(path: &Path) -> Result<InputNames> {
    let header = header(path).unwrap_or_default(); // what cannot be read is refused where the source is opened
    let columns: Vec<&str> = header.split(',').map(str::trim).collect();
    if columns.contains(&"pressure_mpa") || !columns.contains(&"t_s") {
        return Ok(InputNames::default());
    }
    let is_marker = |name: &str| name.starts_with("marker") && name.ends_with("_mm");
    let is_input = |name: &&str| {
        !["t_s", "gap_mm", "measured_force_n"].contains(name)
            && !is_marker(name)
            && in_another_unit(name).is_none()
    };
    let names: Vec<&str> = columns.into_iter().filter(is_input).collect();
    if names.len() > PARAMETERS_MAX || names.iter().any(|name| name.is_empty()) {
        return Err(configuration(anyhow!(
            "{}: expected t_s and at most {PARAMETERS_MAX} columns with the names of model inputs, found {header}",
            path.display()
        )));
    }
    Ok(InputNames::new(names))
}

/// The first line of a table that is no comment.
fn header(path: &Path) -> Option<String> {
    let (file, _) = runtime::file::open(path, u64::MAX).ok()?;
    let lines = BufReader::new(file.take(HEADER_BYTES)).lines().map_while(Result::ok);
    let mut lines = lines.map(|line| line.trim_start_matches('\u{feff}').trim().to_owned());
    lines.find(|line| !line.is_empty() && !line.starts_with('#'))
}

/// A reading for each line that comes in.
fn step(
    bus: &Bus,
    topic: &Topic,
    mut source: Box<dyn Source>,
    inputs: &InputNames,
    stop: &AtomicBool,
) -> Result<u64> {
    let mut writer = SensorWriter::create(bus, topic)?;
    let boot_id = boot_id();
    let mut sent = 0;
    let mut lines = std::io::stdin().lock().lines();
    while !stop.load(Ordering::Relaxed) {
        let Poll::Reading(Reading { sample, .. }) = source.poll(f64::INFINITY) else { break };
        let values = if inputs.has_no_input() {
            format!("{} MPa  {} mm", sample.pressure_mpa, sample.gap_mm)
        } else {
            let pairs = inputs.iter().zip(sample.inputs);
            pairs.map(|(name, value)| format!("{name} {value}")).collect::<Vec<_>>().join("  ")
        };
        output!("{:.6} s  {values}  (Enter sends it)", sample.t_trace_s)?;
        if lines.next().transpose()?.is_none() {
            break;
        }
        sent += 1;
        writer.publish(SensorSample { boot_id, seq: sent, t_sensor_ns: now_ns(), ..sample })?;
    }
    Ok(sent)
}
