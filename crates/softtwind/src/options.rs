//! The command line.

use crate::help::TEMPLATE;
use crate::metrics::MetricsOptions;
use clap::{Args, Parser, Subcommand};
use std::path::PathBuf;
use wire::{Bus, Domain, WireError};

const EXAMPLES: &str = "\
Examples (two terminals):
  softtwind twin   --scene config/scenes/finger.toml
  softtwind bridge --scene config/scenes/finger.toml";

const CODES: &str = "\
Exit codes: 0 stopped as asked or source at its end, 1 run-time failure, 2 usage, 78 configuration. RUST_LOG=debug for more; \
SIGTERM or SIGINT stops cleanly, SIGHUP makes a twin read its scene and models \
again, and a bridge its scene: changed sources are replaced.";

const TWIN: &str = "\
Examples:
  softtwind twin --scene config/scenes/finger.toml";

const BRIDGE: &str = "\
Examples:
  softtwind bridge --scene config/scenes/finger.toml
  softtwind bridge --scene config/scenes/finger.toml \\
    --trace config/traces/gap80.csv --speed 2";

/// Digital twin daemon: readings in, deformed and stressed actuators out, through shared memory.
#[derive(Debug, Parser)]
#[command(name = "softtwind", version, about, before_help = EXAMPLES, help_template = TEMPLATE, after_help = CODES, propagate_version = true)]
pub struct Options {
    #[command(subcommand)]
    pub command: Command,
}

/// Role of the daemon.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Feed readings (a recorded trace, a simulation) into the sensor topics of a scene.
    #[command(before_help = BRIDGE, help_template = TEMPLATE)]
    Bridge(BridgeOptions),
    /// Answer every reading with state and fields of a scene's actuators.
    #[command(before_help = TWIN, help_template = TEMPLATE)]
    Twin(TwinOptions),
}

/// Shared-memory domain: only programs with the same one exchange samples.
#[derive(Debug, Clone, Args)]
pub struct DomainArgs {
    /// Shared-memory domain [default: $SOFTTWIN_DOMAIN, or the user's own].
    #[arg(long, value_name = "NAME")]
    domain: Option<String>,
    /// Folder of the management files [default: $SOFTTWIN_ROOT, or /tmp/softtwin-UID].
    #[arg(long, value_name = "DIR")]
    domain_root: Option<String>,
}

impl DomainArgs {
    /// The shared-memory domain of arguments and environment.
    pub fn domain(&self) -> Domain {
        Domain::given(self.domain.as_deref(), self.domain_root.as_deref())
    }

    /// Joins the shared-memory domain.
    ///
    /// # Errors
    /// As [`Bus::open`].
    pub fn join(&self) -> Result<Bus, WireError> {
        Bus::open(&self.domain())
    }
}

/// Options of `bridge`.
#[derive(Debug, Clone, Args)]
pub struct BridgeOptions {
    /// Scene file: names the actuators and their sources
    #[arg(long, visible_alias = "config", value_name = "FILE")]
    pub scene: PathBuf,
    /// Replay this trace instead of the scene's source (scenes with one actuator)
    #[arg(long, value_name = "CSV")]
    pub trace: Option<PathBuf>,
    /// Mapping of the columns of the trace, if it is a bench's table (softtwin inspect)
    #[arg(long, value_name = "FILE.toml")]
    pub log: Option<PathBuf>,
    /// Factor on the speed of a replay
    #[arg(long, value_name = "FACTOR")]
    pub speed: Option<f64>,
    /// Begin again at the end of a replay
    #[arg(long = "loop")]
    pub repeat: bool,
    /// Begin at this time of the trace
    #[arg(long, value_name = "SECONDS")]
    pub from_s: Option<f64>,
    /// End at this time of the trace
    #[arg(long, value_name = "SECONDS")]
    pub to_s: Option<f64>,
    #[command(flatten)]
    pub metrics: MetricsOptions,
    #[command(flatten)]
    pub domain: DomainArgs,
}

/// Options of `twin`.
#[derive(Debug, Clone, Args)]
pub struct TwinOptions {
    /// Scene file: names the actuators, their models and outputs
    #[arg(long, value_name = "FILE")]
    pub scene: PathBuf,
    /// Settings file: limits and real time [default: built-in, see config/twin.toml]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Use this model instead of the scene's (scenes with one actuator)
    #[arg(long, value_name = "TWIN")]
    pub model: Option<PathBuf>,
    #[command(flatten)]
    pub metrics: MetricsOptions,
    #[command(flatten)]
    pub domain: DomainArgs,
}
