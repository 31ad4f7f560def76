//! `softtwind bridge`: sources to sensor topics.

use crate::bridge_reload::{BridgeReloader, SharedDevices, open};
use crate::options::BridgeOptions;
use crate::reading_use::ReadingUse;
use anyhow::Context;
use runtime::bridge::{Bridge, BridgeCounters, BridgeDevices, BridgeError};
use runtime::config::{self, ActuatorSpec, ConfigError, Scene};
use runtime::metrics as page;
use runtime::service::{self, Watchdog};
use runtime::source::{Devices, SourceSpec};
use runtime::thread_group::{StopFlag, ThreadGroup};
use runtime::valve::{self, OpenValve};
use runtime::wire::{Bus, OwnFiles, Topic, background_thread, now_ns};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Interval of the status thread.
const INTERVAL: Duration = Duration::from_millis(50);
/// Interval of status lines for the service manager.
const STATUS_EVERY: Duration = Duration::from_secs(5);

/// Runs until the sources end or a signal arrives.
pub fn run(options: &BridgeOptions) -> anyhow::Result<()> {
    tracing::info!("softtwind bridge {}", env!("CARGO_PKG_VERSION"));
    let scene = configure(options)?;
    for actuator in &scene.actuators {
        for source in actuator.describe_sources() {
            tracing::info!("{}: {source}", Topic::sensor(&actuator.name)?);
        }
    }
    for valve in scene.actuators.iter().flat_map(ActuatorSpec::all_valves) {
        let (topic, spec) = valve?;
        tracing::info!("{topic}: to {}", spec.describe());
        if !spec.has_watchdog() {
            tracing::warn!(
                "{topic}: no time-out of the device is set (watchdog of [actuator.valve.modbus]): while this bridge is stopped or after \
                 it is killed the last pressure stays, unless the device closes by itself"
            );
        }
    }
    let paths = Devices::default();
    let sources = open(&scene, &options.scene, &paths)?;
    let valves = open_valves(&scene, &options.scene, &paths)?;
    let listener = options.metrics.open()?;
    let stop = service::stop_flag().context("cannot listen for signals")?;
    let bus = Bus::open(&options.domain.domain())?;
    let own_files = OwnFiles::of(&options.domain.domain())?;
    let has_sources = !sources.is_empty();
    let mut bridge = Bridge::start(&bus, sources)?;
    let mut group = ThreadGroup::new(stop.clone());
    paths.start(None).context("no thread for a device")?; // of valves, where there is no source
    let valves = valve::start(&mut group, &options.domain.domain(), valves)?;
    service::notify_ready(&format!("bridge of scene {}, {} actuator(s)", scene.name, scene.actuators.len()));

    let counters = Arc::new(BridgeCounters::default());
    let devices: SharedDevices = Arc::new(Mutex::new(bridge.devices()));
    let (counted, of_devices) = (counters.clone(), devices.clone());
    let (domain, boot_id, begin_ns) = (options.domain.domain(), bridge.boot_id(), now_ns());
    let names: Vec<String> = scene.actuators.iter().map(|actuator| actuator.name.clone()).collect();
    let (signal, unused) = (stop.clone(), Arc::<Mutex<Option<String>>>::default());
    let found = unused.clone();
    group.start("status", move |end| {
        let mut usage = ReadingUse::new(&domain, boot_id, begin_ns, &names)?;
        report(&counted, &of_devices, &mut usage, end);
        if !signal.load(Ordering::Relaxed) {
            *found.lock().unwrap_or_else(PoisonError::into_inner) = usage.unused();
        }
        Ok(())
    })?;
    group.start("files", move |end| service::watch_files(&own_files, end))?;
    let requested = service::reload_flag().context("cannot listen for signals")?;
    let reloader =
        BridgeReloader { scene, sources: bridge.accept_sources(), devices: devices.clone(), paths };
    let own = options.clone();
    group.start("loader", move |end| {
        let path = own.scene.clone();
        reloader.run(&requested, end, &path, move || configure(&own));
        Ok(())
    })?;
    let (counted, of_devices) = (counters.clone(), devices.clone());
    page::start(&mut group, listener, || move || page::bridge(&counted, &lock(&of_devices), &valves))?;
    let ran = if has_sources { bridge.run(&stop, &counters) } else { wait(&stop, &counters) };
    let ended = group.end();

    service::notify_stopping();
    let reason = if stop.load(Ordering::Relaxed) { "signal" } else { "end of the sources" };
    let count = |counter: &std::sync::atomic::AtomicU64| counter.load(Ordering::Relaxed);
    let (sent, late, failed) = (count(&counters.sent), count(&counters.late), count(&counters.failed));
    tracing::info!(
        "stopped ({reason}): {sent} readings sent, {late} of them late, {failed} could not be sent"
    );
    for (name, sensor, device) in &*lock(&devices) {
        tracing::info!("{name} {sensor}: {}", device.summary());
    }
    ended?;
    ran?;
    anyhow::ensure!(failed == 0, "{failed} readings could not be sent");
    if let Some(names) = unused.lock().unwrap_or_else(PoisonError::into_inner).take() {
        anyhow::bail!("no reading of {names} could be used by its twin");
    }
    Ok(())
}

/// The status thread: feeds the watchdog while the loop runs, and updates the status line.
fn report(counters: &BridgeCounters, devices: &SharedDevices, usage: &mut ReadingUse, end: &StopFlag) {
    background_thread();
    let mut watchdog = Watchdog::from_env();
    let mut next_status = Instant::now() + STATUS_EVERY;
    while !end.is_set() {
        watchdog.feed(counters.turns.load(Ordering::Relaxed));
        usage.update();
        if Instant::now() >= next_status {
            next_status = Instant::now() + STATUS_EVERY;
            let mut status = format!("{} readings sent", counters.sent.load(Ordering::Relaxed));
            for (name, sensor, device) in &*lock(devices) {
                status += &format!("; {name} {sensor}: {}", device.summary());
            }
            service::notify_status(&status);
        }
        end.pause(INTERVAL);
    }
}

/// The scene with the options of the command line.
fn configure(options: &BridgeOptions) -> Result<Scene, ConfigError> {
    let mut scene = Scene::load(&options.scene)?;
    let refuse =
        |problem: &str| ConfigError { path: options.scene.clone(), problems: vec![problem.to_owned()] };
    if let Some(trace) = &options.trace {
        let [actuator] = scene.actuators.as_mut_slice() else {
            return Err(refuse("--trace: the scene has several actuators; put their sources into the scene"));
        };
        // A path on the command line is relative to the current folder, not to the scene's.
        let trace = std::path::absolute(trace).unwrap_or_else(|_| trace.clone());
        actuator.source = Some(SourceSpec::replay_of(trace));
        (actuator.sensors, actuator.pace) = (Default::default(), None);
    }
    let mut is_replay = false;
    for actuator in &mut scene.actuators {
        if let Some(SourceSpec::Replay(replay)) = &mut actuator.source {
            is_replay = true;
            if let Some(log) = &options.log {
                replay.log = Some(std::path::absolute(log).unwrap_or_else(|_| log.clone()));
            }
            replay.speed = options.speed.unwrap_or(replay.speed);
            replay.repeat |= options.repeat;
            replay.from_s = options.from_s.unwrap_or(replay.from_s);
            replay.to_s = options.to_s.unwrap_or(replay.to_s);
        }
    }
    if options.log.is_some() && !is_replay {
        return Err(refuse("--log: expected --trace, or a scene whose source is a replay; found neither"));
    }
    Ok(scene)
}

fn lock(devices: &SharedDevices) -> MutexGuard<'_, BridgeDevices> {
    devices.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Waits until `stop` is set: the loop of a bridge that drives valves only.
fn wait(stop: &AtomicBool, counters: &BridgeCounters) -> Result<(), BridgeError> {
    while !stop.load(Ordering::Relaxed) {
        counters.turns.fetch_add(1, Ordering::Relaxed);
        std::thread::sleep(INTERVAL);
    }
    Ok(())
}

/// The valves with their open devices.
fn open_valves(scene: &Scene, path: &Path, devices: &Devices) -> Result<Vec<OpenValve>, ConfigError> {
    let valves = |actuator: &ActuatorSpec| {
        let opened = actuator.all_valves().map(|valve| {
            let (topic, spec) = valve.map_err(|error| vec![error.to_string()])?;
            valve::open(&topic, spec, devices)
        });
        opened.collect::<Vec<_>>()
    };
    let opened = scene
        .actuators
        .iter()
        .flat_map(|actuator| valves(actuator).into_iter().map(|opened| (actuator.name.as_str(), opened)));
    config::collect(path, opened)
}
