//! Cost against nodes, modes, actuators and subscribers.

mod parts;
mod tables;

use serde::Serialize;
use softtwin::progress::Progress;
use softtwin::{full_size, measure::gbps, output};

/// Nodes of the study; the reference actuator among them.
const NODES: [usize; 10] =
    [1_000, 3_000, 10_000, 25_022, 50_000, 100_000, 300_000, 1_000_000, 3_000_000, 10_000_000];
const MODES: [usize; 8] = [1, 2, 4, 6, 8, 12, 16, 24];
const ACTUATORS: [usize; 5] = [1, 2, 5, 10, 20];
const SUBSCRIBERS: [usize; 6] = [0, 1, 2, 4, 8, 16];
/// Time between two readings at 1 kHz, us.
const PERIOD_US: f64 = 1000.0;

/// The result.
#[derive(Debug, Serialize)]
pub struct Study {
    /// Cache sizes as the system reports them.
    pub caches: String,
    /// Against nodes, 6 modes a field.
    pub nodes: Vec<NodesRow>,
    /// Against modes, 25,022 nodes.
    pub modes: Vec<ModesRow>,
    /// Against actuators in one thread.
    pub actuators: Vec<ActuatorsRow>,
    /// Against readers of one field topic.
    pub subscribers: Vec<SubscribersRow>,
}

/// One size of mesh.
#[derive(Debug, Serialize)]
pub struct NodesRow {
    /// Nodes.
    pub nodes: usize,
    /// Bytes of the f32 basis.
    pub bytes: usize,
    /// Reconstruction, median.
    pub f32_us: f64,
    /// The same with an i16 basis.
    pub i16_us: f64,
    /// Reading the f32 basis alone.
    pub read_us: f64,
    /// Basis bytes over `f32_us`.
    pub gbps: f64,
    /// Full fields that one core finishes within 1 ms.
    pub actuators_at_1khz: usize,
}

/// One number of modes.
#[derive(Debug, Serialize)]
pub struct ModesRow {
    /// Modes of each field.
    pub modes: usize,
    /// Bytes of the f32 basis.
    pub bytes: usize,
    /// Reconstruction, median.
    pub f32_us: f64,
    /// The same with an i16 basis.
    pub i16_us: f64,
    /// Basis bytes over `f32_us`.
    pub gbps: f64,
}

/// So many actuators in turn.
#[derive(Debug, Serialize)]
pub struct ActuatorsRow {
    /// Actuators.
    pub actuators: usize,
    /// Bytes of their full bases.
    pub bytes: usize,
    /// Input to full field, us an actuator.
    pub full_us: f64,
    /// Input to force and the fields of 500 nodes, us an actuator.
    pub tip_us: f64,
}

/// So many readers.
#[derive(Debug, Serialize)]
pub struct SubscribersRow {
    /// Readers of the topic.
    pub subscribers: usize,
    /// Taking a free sample, median.
    pub loan_us: f64,
    /// Sending it and waking all readers, median.
    pub send_us: f64,
}

const EXAMPLES: &str = "\
Examples:
  The tables of docs/scale.md (a release build; takes up to 3 GB of memory):
    softtwin-studies scale
  softtwin-studies scale --json";

/// Measure cost against nodes, modes, actuators and subscribers.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// One JSON object on standard output.
    #[arg(long)]
    json: bool,
}

impl Args {
    /// Measures and prints.
    pub fn run(self) -> anyhow::Result<()> {
        let study = measure(&mut Progress::new(false))?;
        if self.json { output::json(&study) } else { tables::print(&study) }
    }
}

/// Measures everything.
fn measure(progress: &mut Progress) -> anyhow::Result<Study> {
    let mut nodes = Vec::new();
    for count in NODES {
        progress.step(&format!("{count} nodes"));
        let cost = parts::kernel(count, full_size::MODES)?;
        nodes.push(NodesRow {
            nodes: count,
            bytes: cost.bytes,
            f32_us: cost.f32_us,
            i16_us: cost.i16_us,
            read_us: cost.read_us,
            gbps: gbps(cost.bytes, cost.f32_us),
            actuators_at_1khz: (PERIOD_US / cost.f32_us) as usize,
        });
    }
    let mut modes = Vec::new();
    for count in MODES {
        progress.step(&format!("{count} modes"));
        let cost = parts::kernel(full_size::NODES, count)?;
        let bandwidth = gbps(cost.bytes, cost.f32_us);
        let (bytes, f32_us, i16_us) = (cost.bytes, cost.f32_us, cost.i16_us);
        modes.push(ModesRow { modes: count, bytes, f32_us, i16_us, gbps: bandwidth });
    }
    progress.step("actuators");
    let actuators = parts::actuators(&ACTUATORS)?;
    progress.step("subscribers");
    let subscribers = parts::subscribers(&SUBSCRIBERS)?;
    Ok(Study { caches: parts::caches(), nodes, modes, actuators, subscribers })
}
