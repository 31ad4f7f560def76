//! `softtwind bridge`: sources to sensor topics.

use crate::options::BridgeOptions;
use crate::{files, metrics};
use anyhow::Context;
use runtime::bridge::{Bridge, BridgeCounters};
use runtime::config::{self, ActuatorSpec, ConfigError, Scene};
use runtime::metrics as page;
use runtime::service::{self, Watchdog};
use runtime::source::{SensorCounters, Source, SourceSpec};
use runtime::thread_group::{StopFlag, ThreadGroup};
use runtime::wire::{Bus, Topic};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Interval of the status thread.
const INTERVAL: Duration = Duration::from_millis(50);
/// How often the service manager gets a new status line.
const STATUS_EVERY: Duration = Duration::from_secs(5);

/// The devices of the bridge by actuator.
type Devices = Vec<(String, Arc<SensorCounters>)>;

/// Runs until the sources end or a signal comes.
pub fn run(options: &BridgeOptions) -> anyhow::Result<()> {
    tracing::info!("softtwind bridge {}", env!("CARGO_PKG_VERSION"));
    let scene = configure(options)?;
    let specs =
        scene.actuators.iter().filter_map(|actuator| Some((&actuator.name, actuator.source.as_ref()?)));
    for (name, spec) in specs {
        tracing::info!("{}: from {}", Topic::sensor(name)?, spec.describe());
    }
    let sources = open(&scene, &options.scene)?;
    let listener = options.metrics.open()?;
    let stop = service::stop_flag().context("cannot listen for signals")?;
    let bus = Bus::open(&options.domain.domain())?;
    let own_files = bus.own_files();
    let mut bridge = Bridge::start(&bus, sources)?;
    service::notify_ready(&format!("bridge of scene {}, {} actuator(s)", scene.name, scene.actuators.len()));

    let counters = Arc::new(BridgeCounters::default());
    let devices: Devices = bridge.devices().map(|(name, device)| (name.to_owned(), device.clone())).collect();
    let mut group = ThreadGroup::new(stop.clone());
    let (counted, of_devices) = (counters.clone(), devices.clone());
    group.start("status", move |end| {
        report(&counted, &of_devices, end);
        Ok(())
    })?;
    group.start(files::NAME, move |end| files::watch(&own_files, end))?;
    let (counted, of_devices) = (counters.clone(), devices.clone());
    metrics::serve(&mut group, listener, || move || page::bridge(&counted, &of_devices))?;
    let ran = bridge.run(&stop, &counters);
    let ended = group.end();

    service::notify_stopping();
    let reason = if stop.load(Ordering::Relaxed) { "signal" } else { "end of the sources" };
    let count = |counter: &std::sync::atomic::AtomicU64| counter.load(Ordering::Relaxed);
    let (sent, late, failed) = (count(&counters.sent), count(&counters.late), count(&counters.failed));
    tracing::info!(
        "stopped ({reason}): {sent} readings sent, {late} of them late, {failed} could not be sent"
    );
    for (name, device) in &devices {
        tracing::info!("{name}: {}", device.summary());
    }
    ended?;
    ran?;
    anyhow::ensure!(failed == 0, "{failed} readings could not be sent");
    Ok(())
}

/// The thread beside the loop: feeds the watchdog while the loop turns, and keeps the status line true.
fn report(counters: &BridgeCounters, devices: &Devices, end: &StopFlag) {
    let mut watchdog = Watchdog::from_env();
    let mut next_status = Instant::now() + STATUS_EVERY;
    while !end.is_set() {
        watchdog.feed(counters.turns.load(Ordering::Relaxed));
        if Instant::now() >= next_status {
            next_status = Instant::now() + STATUS_EVERY;
            let mut status = format!("{} readings sent", counters.sent.load(Ordering::Relaxed));
            for (name, device) in devices {
                status += &format!("; {name}: {}", device.summary());
            }
            service::notify_status(&status);
        }
        end.pause(INTERVAL);
    }
}

/// The scene with the command line's changes.
fn configure(options: &BridgeOptions) -> Result<Scene, ConfigError> {
    let mut scene = Scene::load(&options.scene)?;
    let refuse =
        |problem: &str| ConfigError { path: options.scene.clone(), problems: vec![problem.to_owned()] };
    if let Some(trace) = &options.trace {
        let [actuator] = scene.actuators.as_mut_slice() else {
            return Err(refuse("--trace: the scene has several actuators; put their sources into the scene"));
        };
        // A path on the command line begins at the current folder, not at the scene's.
        let trace = std::path::absolute(trace).unwrap_or_else(|_| trace.clone());
        actuator.source = Some(SourceSpec::replay_of(trace));
    }
    for actuator in &mut scene.actuators {
        if let Some(SourceSpec::Replay(replay)) = &mut actuator.source {
            replay.speed = options.speed.unwrap_or(replay.speed);
            replay.repeat |= options.repeat;
            replay.from_s = options.from_s.unwrap_or(replay.from_s);
            replay.to_s = options.to_s.unwrap_or(replay.to_s);
        }
    }
    Ok(scene)
}

/// Sources by the name of their actuator.
type Sources = Vec<(String, Box<dyn Source>)>;

/// Opens all sources; actuators without one are fed by another program.
fn open(scene: &Scene, path: &Path) -> Result<Sources, ConfigError> {
    let open = |actuator: &ActuatorSpec| {
        let spec = actuator.source.as_ref()?;
        Some((spec.open(&scene.folder)).map(|source| (actuator.name.clone(), source)))
    };
    let opened =
        scene.actuators.iter().filter_map(|actuator| Some((actuator.name.as_str(), open(actuator)?)));
    let sources = config::collect(path, opened)?;
    let none = "no actuator has a source; add [actuator.source] or use --trace".to_owned();
    ConfigError::unless(path, if sources.is_empty() { vec![none] } else { Vec::new() })?;
    Ok(sources)
}
