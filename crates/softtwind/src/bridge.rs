//! `softtwind bridge`: sources to sensor topics.

use crate::options::BridgeOptions;
use anyhow::Context;
use runtime::bridge::{Bridge, BridgeCounters};
use runtime::config::{ConfigError, Scene};
use runtime::metrics;
use runtime::service::{self, Watchdog};
use runtime::source::live::SensorCounters;
use runtime::source::{Source, SourceSpec};
use runtime::wire::{Bus, Topic};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// How often the slow thread looks.
const KEEP_EVERY: Duration = Duration::from_millis(50);
/// How often the service manager is told how far we are.
const STATUS_EVERY: Duration = Duration::from_secs(5);

/// Runs until the sources end or a signal comes.
pub fn run(options: &BridgeOptions) -> anyhow::Result<()> {
    tracing::info!("softtwind bridge {}", env!("CARGO_PKG_VERSION"));
    let scene = configure(options)?;
    let sources = open(&scene, &options.scene)?;
    for (name, source) in &sources {
        tracing::info!("{}: from {}", Topic::sensor(name)?, describe(source, &scene, name));
    }
    let names: Vec<String> = sources.iter().map(|(name, _)| name.clone()).collect();
    let listener = options.metrics.open()?;
    let stop = service::stop_flag().context("cannot listen for signals")?;
    let bus = Bus::open(&options.domain.domain())?;
    let mut bridge = Bridge::start(&bus, sources)?;
    service::tell_ready(&format!("bridge of scene {}, {} actuator(s)", scene.name, scene.actuators.len()));

    let counters = BridgeCounters::default();
    let sensors: Vec<(String, Arc<SensorCounters>)> = bridge
        .sensors()
        .map(|(number, counters)| (names.get(number).cloned().unwrap_or_default(), counters.clone()))
        .collect();
    let page = || {
        let sensors: Vec<(String, &SensorCounters)> =
            sensors.iter().map(|(name, counters)| (name.clone(), counters.as_ref())).collect();
        metrics::bridge(&counters, &sensors)
    };
    let done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| keep(&counters, &sensors, &done));
        if let Some(listener) = listener {
            scope.spawn(|| crate::metrics::serve(listener, &done, page));
        }
        bridge.run(&stop, &counters);
        done.store(true, Ordering::Release);
    });

    service::tell_stopping();
    let reason = if stop.load(Ordering::Relaxed) { "signal" } else { "end of the sources" };
    let count = |counter: &std::sync::atomic::AtomicU64| counter.load(Ordering::Relaxed);
    let (sent, late, failed) = (count(&counters.sent), count(&counters.late), count(&counters.failed));
    tracing::info!(
        "stopped ({reason}): {sent} readings sent, {late} of them late, {failed} could not be sent"
    );
    for (name, counters) in &sensors {
        tracing::info!("{name}: {}", account(counters));
    }
    anyhow::ensure!(failed == 0, "{failed} readings could not be sent");
    Ok(())
}

/// The slow thread beside the loop: feeds the watchdog while the loop turns, and keeps the status line true.
fn keep(counters: &BridgeCounters, sensors: &[(String, Arc<SensorCounters>)], done: &AtomicBool) {
    let mut watchdog = Watchdog::from_env();
    let mut next_status = Instant::now() + STATUS_EVERY;
    while !done.load(Ordering::Acquire) {
        watchdog.look(counters.turns.load(Ordering::Relaxed));
        if Instant::now() >= next_status {
            next_status = Instant::now() + STATUS_EVERY;
            let mut status = format!("{} readings sent", counters.sent.load(Ordering::Relaxed));
            for (name, counters) in sensors {
                status += &format!("; {name}: {}", account(counters));
            }
            service::tell_status(&status);
        }
        std::thread::sleep(KEEP_EVERY);
    }
}

/// What became of a sensor's answers, without the zeros.
fn account(counters: &SensorCounters) -> String {
    let counted: Vec<String> = counters
        .all()
        .iter()
        .filter(|(name, count)| *count > 0 || *name == "readings")
        .map(|(name, count)| format!("{count} {name}"))
        .collect();
    counted.join(", ")
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
        // The path was typed in this folder, not in the scene's.
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

/// Opens all sources; actuators without one are fed by somebody else.
fn open(scene: &Scene, path: &Path) -> Result<Vec<(String, Source)>, ConfigError> {
    let mut problems = Vec::new();
    let mut sources = Vec::new();
    for actuator in &scene.actuators {
        let Some(spec) = &actuator.source else { continue };
        match spec.open(&scene.folder) {
            Ok(source) => sources.push((actuator.name.clone(), source)),
            Err(found) => {
                problems.extend(found.into_iter().map(|text| format!("actuator `{}`: {text}", actuator.name)))
            }
        }
    }
    if sources.is_empty() && problems.is_empty() {
        problems.push("no actuator has a source; add [actuator.source] or use --trace".into());
    }
    if problems.is_empty() { Ok(sources) } else { Err(ConfigError { path: path.into(), problems }) }
}

/// The effective source, gaps in time said now, not when they come.
fn describe(source: &Source, scene: &Scene, name: &str) -> String {
    if let Source::Replay(replay) = source {
        for (line, seconds) in replay.gaps() {
            tracing::warn!("{name}: the trace has a gap of {seconds:.3} s before line {line}");
        }
    }
    let spec = scene.actuators.iter().find(|actuator| actuator.name == name).and_then(|a| a.source.as_ref());
    spec.map(|spec| format!("{spec:?}")).unwrap_or_default()
}
