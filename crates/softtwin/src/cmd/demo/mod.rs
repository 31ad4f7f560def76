//! `softtwin demo`: bridge and twin as two real processes, a live line, a summary.

mod watch;

use crate::daemon::Daemon;
use crate::failure::{configuration, usage};
use crate::output;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use watch::Watch;
use wire::{Bus, Domain};

const EXAMPLES: &str = "\
Examples:
  softtwin demo
  softtwin demo --trace config/traces/gap80.csv
  softtwin demo --seconds 10 --json

Starts `softtwind twin` and `softtwind bridge` in a shared-memory domain of their own and subscribes like any program.
`lost` counts readings whose field this program did not receive.";

/// Watch a recorded pressure trace become live fields through two real processes.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// Scene with one actuator.
    #[arg(long, value_name = "FILE", default_value = "config/scenes/finger.toml")]
    scene: PathBuf,
    /// Replay this trace instead of the scene's source.
    #[arg(long, value_name = "CSV")]
    trace: Option<PathBuf>,
    /// Use this model instead of the scene's.
    #[arg(long, value_name = "TWIN")]
    model: Option<PathBuf>,
    /// Run for so many seconds, the trace again and again [default: once through the trace].
    #[arg(long, value_name = "N", value_parser = crate::range::seconds)]
    seconds: Option<f64>,
    /// End with one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

impl Args {
    /// Runs the demonstration.
    pub fn run(self) -> anyhow::Result<()> {
        let limit = self.seconds.map(Duration::from_secs_f64);
        let actuator = self.actuator()?;
        let stop = runtime::service::stop_flag()?;
        let name = format!("demo_{}", std::process::id());
        let domain = Domain { root: Domain::from_env().root, ..Domain::named(&name) };
        let bus = Bus::open(&domain)?;

        let mut twin = Daemon::softtwind("twin", &self.arguments(&name, "--model", self.model.as_deref()))?;
        twin.wait_ready(&stop)?;
        let mut watch = Watch::open(&bus, &actuator, !self.json)?;
        let mut arguments = self.arguments(&name, "--trace", self.trace.as_deref());
        arguments.extend(self.seconds.map(|_| "--loop".into()));
        let mut bridge = Daemon::softtwind("bridge", &arguments)?;
        let reason = follow(&mut watch, &mut twin, &mut bridge, limit, &stop)?;
        bridge.stop()?;
        watch.drain()?;
        twin.stop()?;

        let summary = watch.summary(reason);
        drop(bus);
        domain.remove_leftovers()?; // the domain was made for this run
        if self.json { output::json(&summary) } else { summary.print() }
    }

    /// The one actuator of the scene. A wrong scene is an error before any process starts.
    fn actuator(&self) -> anyhow::Result<String> {
        let scene = runtime::config::Scene::load(&self.scene).map_err(configuration)?;
        let [actuator] = scene.actuators.as_slice() else {
            return Err(usage(format!("--scene: expected one actuator, found {}", scene.actuators.len())));
        };
        let model = self.model.clone().unwrap_or_else(|| scene.resolve(&actuator.model));
        if !model.exists() {
            return Err(configuration(anyhow::anyhow!(
                "the model is not there; make it with `softtwin train --database DIR --out FILE.twin`, or name another \
                 with --model ({})",
                model.display()
            )));
        }
        Ok(actuator.name.clone())
    }

    /// Scene and domain, which both processes need, and an option that only one has.
    fn arguments(&self, domain: &str, option: &str, path: Option<&Path>) -> Vec<OsString> {
        let mut arguments =
            vec!["--scene".into(), self.scene.clone().into(), "--domain".into(), domain.into()];
        if let Some(path) = path {
            arguments.extend([option.into(), path.into()]);
        }
        arguments
    }
}

/// Receives until the bridge has sent the whole trace, the time is over, a signal comes or a process dies; returns which.
fn follow(
    watch: &mut Watch,
    twin: &mut Daemon,
    bridge: &mut Daemon,
    limit: Option<Duration>,
    stop: &Arc<AtomicBool>,
) -> anyhow::Result<&'static str> {
    let begin = Instant::now();
    loop {
        watch.receive(Duration::from_millis(50))?;
        if twin.ended()? {
            anyhow::bail!("the twin ended by itself:\n{}", twin.log());
        }
        if bridge.ended()? {
            return if bridge.succeeded() {
                Ok("end of trace")
            } else {
                anyhow::bail!("the bridge failed:\n{}", bridge.log())
            };
        }
        if stop.load(Ordering::Relaxed) {
            return Ok("signal");
        }
        if limit.is_some_and(|limit| begin.elapsed() >= limit) {
            return Ok("time");
        }
    }
}
