//! Cost against nodes, modes, actuators and subscribers.

mod parts;
mod tables;

use crate::bench::full_size;
use softtwin::output;
use softtwin::progress::Progress;
use tables::{ModesRow, NodesRow, Study};

/// Nodes of the study; the reference actuator among them.
const NODES: [usize; 10] =
    [1_000, 3_000, 10_000, 25_022, 50_000, 100_000, 300_000, 1_000_000, 3_000_000, 10_000_000];
const MODES: [usize; 8] = [1, 2, 4, 6, 8, 12, 16, 24];
const ACTUATORS: [usize; 5] = [1, 2, 5, 10, 20];
const SUBSCRIBERS: [usize; 6] = [0, 1, 2, 4, 8, 16];
/// Time between two readings at 1 kHz, us.
const PERIOD_US: f64 = 1000.0;

const EXAMPLES: &str = "\
Examples:
  The tables of docs/scale.md (a release build; takes up to 3 GB of memory):
    softtwin-studies scale
  softtwin-studies scale --json";

/// Measure cost against nodes, modes, actuators and subscribers.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// One JSON object on standard output.
    #[arg(long)]
    json: bool,
}

impl Args {
    /// Measures and prints.
    pub fn run(self) -> anyhow::Result<()> {
        let study = measure(&mut Progress::new(false))?;
        if self.json { output::json(&study) } else { study.print() }
    }
}

/// Measures everything.
fn measure(progress: &mut Progress) -> anyhow::Result<Study> {
    let mut nodes = Vec::new();
    for count in NODES {
        progress.step(&format!("{count} nodes"));
        let cost = parts::kernel(count, full_size::MODES)?;
        nodes.push(NodesRow { nodes: count, actuators_at_1khz: (PERIOD_US / cost.f32_us) as usize, cost });
    }
    let mut modes = Vec::new();
    for count in MODES {
        progress.step(&format!("{count} modes"));
        modes.push(ModesRow { modes: count, cost: parts::kernel(full_size::NODES, count)? });
    }
    progress.step("actuators");
    let actuators = parts::actuators(&ACTUATORS)?;
    progress.step("subscribers");
    let subscribers = parts::subscribers(&SUBSCRIBERS)?;
    Ok(Study { caches: parts::caches(), nodes, modes, actuators, subscribers })
}
