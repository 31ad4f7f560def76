//! `softtwind twin`: readings to states and fields.

use crate::exclusive::ExclusiveServices;
use crate::options::TwinOptions;
use crate::side_services::SideServices;
use crate::take_over::{Ended, TakeOver};
use crate::{files, reload, reporter};
use anyhow::Context;
use runtime::config::{ConfigError, OnMissingRights, Scene, Settings};
use runtime::load::{Loaded, load_scene};
use runtime::thread_group::ThreadGroup;
use runtime::twin::{Twin, event_channel};
use runtime::wire::{Bus, Health, Outcome, SpinCounts, SpinWait, layout};
use runtime::{realtime, service};
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::sync::mpsc::channel;
use std::time::{Duration, Instant};

/// How long a twin that takes over waits for the other one to give its topics, and to end.
const PATIENCE: Duration = Duration::from_secs(10);

/// Runs until a signal comes, or until another twin takes over.
pub fn run(options: &TwinOptions) -> anyhow::Result<Ended> {
    tracing::info!("softtwind twin {}", env!("CARGO_PKG_VERSION"));
    let settings = options.config.as_deref().map(Settings::load).transpose()?.unwrap_or_default();
    let scene = configure(options)?;
    let loaded = load_scene(&scene, &options.scene)?;
    let side_services = SideServices::load(&scene, &options.scene)?;
    say_settings(&settings);
    loaded.iter().for_each(describe);
    let names: Vec<String> = loaded.iter().map(|actuator| actuator.spec.name.clone()).collect();

    let estimates = |actuator: &Loaded| !actuator.spec.estimate.is_empty();
    let shown: Vec<_> = names.iter().cloned().zip(loaded.iter().map(estimates)).collect();

    let stop = service::stop_flag().context("cannot listen for signals")?;
    let domain = options.domain.domain();
    let bus = Bus::open(&domain)?;
    let (sender, events) = event_channel();
    let enter = if options.take_over { Twin::stand_by } else { Twin::start };
    let mut twin = enter(&bus, loaded, &settings, &sender)?;
    let topics = twin.state_topics();
    let replaced = TakeOver::new(bus.take_over_watch(&topics));
    let progress = Arc::new(AtomicU64::new(0));
    let (inbox, loader) = reload::pair();
    let reload = service::reload_flag().context("cannot listen for signals")?;
    let own_files = bus.own_files();
    let mut group = ThreadGroup::new(stop.clone());
    // All threads start before this one takes real-time rights, so that they do not inherit them.
    let (reported, progressed) = (names.clone(), progress.clone());
    group.start("reporter", move |end| {
        reporter::run(&events, &reported, &progressed, end);
        Ok(())
    })?;
    group.start(files::NAME, move |end| files::watch(&own_files, end))?;
    let looking = replaced.clone();
    group.start("take-over", move |end| {
        looking.look(end);
        Ok(())
    })?;
    let metrics = options.metrics.clone();
    let mut exclusive = Some(ExclusiveServices { metrics, shown, services: side_services, domain, topics });
    let started =
        exclusive.take_if(|_| !options.take_over).map(|services| services.start(&mut group)).transpose()?;
    let (place, services) = started.unzip();
    let (taken, when_taken) = channel();
    let (reread_options, program) = (options.clone(), stop.clone());
    group.start("loader", move |end| {
        let mut late = ThreadGroup::new(program);
        let (_place, services) = match (services, exclusive) {
            (Some(services), _) => (None, services),
            (None, Some(exclusive)) if when_taken.recv().is_ok() => {
                let (place, services) = exclusive.start(&mut late)?;
                (Some(place), services)
            }
            _ => return Ok(()), // it could not take over
        };
        loader.run(&reload, end, &services, || reread(&reread_options));
        Ok(late.end()?)
    })?;
    let granted = prepare(&settings, &twin)?;
    if options.take_over {
        let refused = "the twin that runs did not give its topics: it serves other actuators, hangs, or is of a version that cannot; \
                       stop it first";
        twin.take_over(&bus, PATIENCE).context(refused)?;
        twin.turn(Duration::ZERO); // readings wait: everything else comes after them
        tracing::info!("the topics are taken over");
        taken.send(())?;
    }
    replaced.begin();
    service::notify_ready(&format!("twin of scene {}: {}", scene.name, names.join(", ")));
    let began = Instant::now();
    twin.run(&stop, &progress, |twin| {
        inbox.swap(twin);
        replaced.give_way(twin, &stop);
    });
    service::notify_stopping();
    drop(granted);
    group.end()?;
    drop(place);
    if let Some(counts) = twin.spin_counts() {
        say_spins(&counts, began.elapsed());
    }
    for (health, name) in twin.health().zip(&names) {
        tracing::info!("stopped: {name}: {}", summary(health));
    }
    if replaced.is_replaced() {
        tracing::info!("another twin has taken over");
        return Ok(Ended::Replaced);
    }
    Ok(Ended::Stopped)
}

/// The scene with the command line's changes.
fn configure(options: &TwinOptions) -> Result<Scene, ConfigError> {
    let mut scene = Scene::load(&options.scene)?;
    if let Some(model) = &options.model {
        let [actuator] = scene.actuators.as_mut_slice() else {
            let problem =
                "--model: the scene has several actuators; name their models in the scene".to_owned();
            return Err(ConfigError { path: options.scene.clone(), problems: vec![problem] });
        };
        // A path on the command line begins at the current folder, not at the scene's.
        actuator.model = std::path::absolute(model).unwrap_or_else(|_| model.clone());
    }
    Ok(scene)
}

/// Scene and models once more, as at the start.
fn reread(options: &TwinOptions) -> Result<reload::Reloaded, ConfigError> {
    let scene = configure(options)?;
    Ok((load_scene(&scene, &options.scene)?, SideServices::load(&scene, &options.scene)?))
}

/// Real-time rights: a refusal is logged once, and stops the start when so configured.
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

/// The settings in force that an operator asks for first.
fn say_settings(settings: &Settings) {
    let (limits, realtime) = (&settings.limits, &settings.realtime);
    tracing::info!(
        "readings of {} to {} MPa and at most {} mm are taken; without a good one for {} ms the state is stale",
        limits.pressure_min_mpa,
        limits.pressure_max_mpa,
        limits.gap_max_mm,
        limits.deadline_ms
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
    let waits = if realtime.busy_poll {
        "spins".to_owned()
    } else if realtime.spin_share > 0.0 && SpinWait::is_possible() {
        let percent = 100.0 * realtime.spin_share;
        format!("sleeps, then spins before each expected one, at most {percent:.0} % of a core")
    } else {
        "sleeps until woken".to_owned()
    };
    tracing::info!("{scheduler}, {cores}, {memory}; between readings it {waits}");
}

/// What spinning for readings came to.
fn say_spins(counts: &SpinCounts, ran: Duration) {
    let SpinCounts { caught, before, in_vain, spun_ns } = counts;
    let percent = 100.0 * *spun_ns as f64 / ran.as_nanos() as f64;
    tracing::info!(
        "spun {percent:.1} % of a core for expected readings: {caught} came meanwhile, {before} before, {in_vain} spins in vain"
    );
}

fn describe(loaded: &Loaded) {
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
