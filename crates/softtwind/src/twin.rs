//! `softtwind twin`: readings to states and fields.

use crate::options::TwinOptions;
use crate::side_services::SideServices;
use crate::{metrics, reload, reporter};
use anyhow::Context;
use runtime::config::{ConfigError, OnMissingRights, Scene, Settings};
use runtime::load::{LoadedActuator, load_scene};
use runtime::thread_group::ThreadGroup;
use runtime::twin::{Twin, event_channel};
use runtime::wire::{Bus, Health, Outcome, OwnFiles, layout};
use runtime::{realtime, service};
use std::sync::Arc;
use std::sync::atomic::AtomicU64;

/// Runs until a signal arrives.
pub fn run(options: &TwinOptions) -> anyhow::Result<()> {
    tracing::info!("softtwind twin {}", env!("CARGO_PKG_VERSION"));
    let settings = options.config.as_deref().map(Settings::load).transpose()?.unwrap_or_default();
    let scene = configure(options)?;
    let loaded = load_scene(&scene, &options.scene)?;
    let side_services = SideServices::load(&scene, &options.scene)?;
    log_settings(&settings);
    loaded.iter().for_each(describe);
    let names: Vec<String> = loaded.iter().map(|actuator| actuator.spec.name.clone()).collect();

    let estimates = |actuator: &LoadedActuator| !actuator.spec.estimate.is_empty();
    let shown: Vec<_> = names.iter().cloned().zip(loaded.iter().map(estimates)).collect();

    let stop = service::stop_flag().context("cannot listen for signals")?;
    let domain = options.domain.domain();
    let bus = Bus::open(&domain)?;
    let (sender, events) = event_channel();
    let mut twin = Twin::start(&bus, loaded, &settings, &sender)?;
    let progress = Arc::new(AtomicU64::new(0));
    let (inbox, loader) = reload::pair();
    let reload = service::reload_flag().context("cannot listen for signals")?;
    let own_files = OwnFiles::of(&domain)?;
    let mut group = ThreadGroup::new(stop.clone());
    // All threads start before this one takes real-time rights, so that they do not inherit them.
    let (reported, progressed) = (names.clone(), progress.clone());
    group.start("reporter", move |end| {
        reporter::run(&events, &reported, &progressed, end);
        Ok(())
    })?;
    group.start("files", move |end| service::watch_files(&own_files, end))?;
    let listener = options.metrics.open()?;
    let metrics_domain = domain.clone();
    runtime::metrics::start(&mut group, listener, move || metrics::twins(&metrics_domain, &shown))?;
    let services = side_services.start(&mut group, &domain)?;
    let reread_options = options.clone();
    group.start("loader", move |end| {
        loader.run(&reload, end, &services, move || reread(&reread_options));
        Ok(())
    })?;
    let granted = prepare(&settings, &twin)?;
    service::notify_ready(&format!("twin of scene {}: {}", scene.name, names.join(", ")));
    twin.run(&stop, &progress, |twin| inbox.swap(twin));
    service::notify_stopping();
    drop(granted);
    group.end()?;
    for (health, name) in twin.health().zip(&names) {
        tracing::info!("stopped: {name}: {}", summary(health));
    }
    Ok(())
}

/// The scene with the options of the command line.
fn configure(options: &TwinOptions) -> Result<Scene, ConfigError> {
    let mut scene = Scene::load(&options.scene)?;
    if let Some(model) = &options.model {
        let [actuator] = scene.actuators.as_mut_slice() else {
            let problem =
                "--model: the scene has several actuators; name their models in the scene".to_owned();
            return Err(ConfigError { path: options.scene.clone(), problems: vec![problem] });
        };
        // A path on the command line is relative to the current folder, not to the scene's.
        actuator.model = std::path::absolute(model).unwrap_or_else(|_| model.clone());
    }
    Ok(scene)
}

/// Reads scene and models again.
fn reread(options: &TwinOptions) -> Result<reload::Reloaded, ConfigError> {
    let scene = configure(options)?;
    Ok((load_scene(&scene, &options.scene)?, SideServices::load(&scene, &options.scene)?))
}

/// Takes real-time rights. Missing ones are logged once, or stop the start if so configured.
fn prepare(settings: &Settings, twin: &Twin) -> anyhow::Result<realtime::Granted> {
    let granted = realtime::apply(&settings.realtime);
    let mut missing: Vec<String> = granted.missing.iter().map(ToString::to_string).collect();
    if settings.realtime.prefault
        && let Err(error) = twin.prefault()
    {
        missing.push(format!("realtime.prefault: refused: {error}"));
    }
    if !missing.is_empty() && settings.realtime.on_missing_rights == OnMissingRights::Stop {
        anyhow::bail!(
            "real-time rights are missing and on_missing_rights = \"stop\":\n  {}",
            missing.join("\n  ")
        );
    }
    for text in &missing {
        tracing::warn!("REAL TIME IS NOT WHAT WAS ASKED FOR: {text}");
    }
    Ok(granted)
}

fn log_settings(settings: &Settings) {
    let (limits, realtime) = (&settings.limits, &settings.realtime);
    let deadline = match limits.deadline_ms {
        Some(deadline_ms) => format!("{deadline_ms} ms"),
        None => "4 intervals of the source and at least 100 ms".into(),
    };
    tracing::info!(
        "readings of {} to {} MPa and at most {} mm are accepted; without one for {} the state is stale",
        limits.pressure_min_mpa,
        limits.pressure_max_mpa,
        limits.gap_max_mm,
        deadline
    );
    let scheduler = match realtime.fifo_priority {
        0 => "ordinary scheduler".to_owned(),
        priority => format!("real-time priority {priority}"),
    };
    let cores = match realtime.cores.as_slice() {
        [] => "any core".to_owned(),
        cores => format!("cores {cores:?}"),
    };
    let memory = if realtime.lock_memory { "memory locked" } else { "memory not locked" };
    let waits = if realtime.busy_poll { "spins" } else { "sleeps until woken" };
    tracing::info!("{scheduler}, {cores}, {memory}; between readings it {waits}");
}

fn describe(loaded: &LoadedActuator) {
    let read: u64 = loaded.read.iter().map(|block| block.bytes).sum();
    let regimes = loaded.regime_names();
    let hash = layout::hex(&loaded.model_hash);
    tracing::info!(
        "{}: model {hash}, regimes {}, {read} of {} bytes read ({})",
        loaded.spec.name,
        regimes.join(" and "),
        loaded.file_block_bytes,
        loaded.spec.model.display()
    );
    for input in runtime::explain::inputs(loaded) {
        tracing::info!("{}: {input}", loaded.spec.name);
    }
    for output in &loaded.outputs {
        let topic = output.spec.topic_name().map(|set| format!("/{set}")).unwrap_or_default();
        tracing::info!(
            "softtwin/{}/field{topic}: {} nodes x {} ({})",
            loaded.spec.name,
            output.reconstructor.rows(),
            output.fields.len(),
            output.fields.join(", ")
        );
    }
}

fn summary(health: &Health) -> String {
    let ends: Vec<String> = Outcome::ALL
        .iter()
        .filter(|outcome| health.count(**outcome) > 0)
        .map(|outcome| format!("{} {outcome}", health.count(*outcome)))
        .collect();
    let flags: Vec<&str> = layout::flags::names(health.flags).collect();
    format!(
        "{} readings ({}), {} never arrived, {} fields sent, {} deadlines missed, flags [{}]",
        health.received,
        ends.join(", "),
        health.missed,
        health.fields_sent,
        health.deadline_misses,
        flags.join(", ")
    )
}
