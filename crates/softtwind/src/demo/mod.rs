//! `softtwin demo`: bridge and twin as two real processes, a live line, a summary.

mod watch;

use crate::daemon::{Daemon, program};
use crate::failure::{configuration, usage};
use crate::{output, shared_files};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use watch::DemoWatch;
use wire::{Bus, Domain};

const EXAMPLES: &str = "\
Examples:
  softtwin demo
  softtwin demo --trace config/traces/gap80.csv
  softtwin demo --seconds 10 --json
  softtwin demo --view

Scene, model and trace are those that come with softtwin, found from any folder, unless others are named. \
Starts `softtwind twin` and `softtwind bridge` in a separate shared-memory domain and subscribes as other programs do. \
`lost` counts readings whose field this program did not receive.";

/// Watch a recorded pressure trace become live fields through two real processes.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES, help_template = crate::help::TEMPLATE)]
pub struct Args {
    /// Scene with one actuator [default: config/scenes/finger.toml, which comes with softtwin].
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Replay this trace instead of the scene's source.
    #[arg(long, value_name = "CSV")]
    trace: Option<PathBuf>,
    /// Use this model instead of the scene's.
    #[arg(long, value_name = "TWIN")]
    model: Option<PathBuf>,
    /// Run for this number of seconds, repeating the trace [default: once through the trace; with --view until Ctrl-C].
    #[arg(long, value_name = "N", value_parser = crate::range::seconds)]
    seconds: Option<f64>,
    /// Show it in a browser as well: starts `softtwin view` and prints its address.
    #[arg(long)]
    view: bool,
    /// End with one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

/// The command line of the program `softtwin-demo`.
pub fn command() -> clap::Command {
    <Args as clap::Args>::augment_args(clap::Command::new("softtwin-demo").version(env!("CARGO_PKG_VERSION")))
}

impl Args {
    /// Runs the demonstration.
    pub fn run(self) -> anyhow::Result<()> {
        let limit = self.seconds.map(Duration::from_secs_f64);
        let scene = self.scene()?;
        let actuator = self.actuator(&scene)?;
        let stop = runtime::service::stop_flag()?;
        let name = format!("demo_{}", std::process::id());
        let domain = Domain::of(Some(&name), Domain::from_env().root);
        let bus = Bus::open(&domain)?;

        let mut twin =
            Daemon::softtwind("twin", &arguments(&scene, &name, "--model", self.model.as_deref()))?;
        twin.wait_ready(&stop)?;
        let page = self.view.then(|| self.page(&scene, &name)).transpose()?;
        let mut watch = DemoWatch::open(&bus, &actuator, !self.json)?;
        let mut arguments = arguments(&scene, &name, "--trace", self.trace.as_deref());
        if self.seconds.is_some() || self.view {
            arguments.push("--loop".into());
        }
        let mut programs = Programs { twin, bridge: Daemon::softtwind("bridge", &arguments)?, page };
        let reason = follow(&mut watch, &mut programs, limit, &stop)?;
        let Programs { mut twin, mut bridge, page } = programs;
        drop(page);
        bridge.stop()?;
        watch.drain()?;
        twin.stop()?;

        let summary = watch.summary(reason);
        drop(bus);
        domain.remove_leftovers()?; // of this run only
        if self.json { output::json(&summary) } else { summary.print() }
    }

    fn scene(&self) -> anyhow::Result<PathBuf> {
        let found = self.scene.clone().map_or_else(|| shared_files::find("config/scenes/finger.toml"), Ok);
        found.map_err(configuration)
    }

    /// The one actuator of the scene. A wrong scene is an error before any process starts.
    fn actuator(&self, path: &Path) -> anyhow::Result<String> {
        let scene = runtime::config::Scene::load(path).map_err(configuration)?;
        let [actuator] = scene.actuators.as_slice() else {
            return Err(usage(format!("--scene: expected one actuator, found {}", scene.actuators.len())));
        };
        let model = self.model.clone().unwrap_or_else(|| actuator.model.clone());
        if !model.exists() {
            return Err(configuration(anyhow::anyhow!(
                "the model is not there; make it with `softtwin train --database DIR --out FILE.twin`, or name another \
                 with --model ({})",
                model.display()
            )));
        }
        Ok(actuator.name.clone())
    }

    /// Starts the web viewer and prints its address to standard error; standard output is for results.
    fn page(&self, scene: &Path, domain: &str) -> anyhow::Result<Daemon> {
        let mut command = Command::new(program("softtwin")?);
        command.args(["view", "--domain", domain, "--scene"]).arg(scene).stdout(std::io::stderr());
        if let Some(model) = &self.model {
            command.arg("--model").arg(model);
        }
        Daemon::start("page", &mut command)
    }
}

/// The processes of a demonstration.
struct Programs {
    twin: Daemon,
    bridge: Daemon,
    page: Option<Daemon>,
}

/// Scene and domain, which both processes need, and an option that only one has.
fn arguments(scene: &Path, domain: &str, option: &str, path: Option<&Path>) -> Vec<OsString> {
    let mut arguments = vec!["--scene".into(), scene.into(), "--domain".into(), domain.into()];
    if let Some(path) = path {
        arguments.extend([option.into(), path.into()]);
    }
    arguments
}

/// Receives until the bridge has sent the whole trace, the time is over, a signal comes or a process dies; returns which.
fn follow(
    watch: &mut DemoWatch,
    Programs { twin, bridge, page }: &mut Programs,
    limit: Option<Duration>,
    stop: &Arc<AtomicBool>,
) -> anyhow::Result<&'static str> {
    let begin = Instant::now();
    loop {
        watch.receive(Duration::from_millis(50))?;
        twin.check()?;
        page.as_mut().map_or(Ok(()), Daemon::check)?;
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
