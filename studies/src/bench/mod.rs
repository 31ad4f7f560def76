//! `softtwin-studies bench`: what a twin costs on this machine, against what the machine can do.

mod comparison;
pub mod compute;
pub mod full_size;
mod live;
pub mod measure;
mod picture;
mod report;

use softtwin::progress::Progress;
use softtwin::shared_files;
use softtwin::{files, output};
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  Everything, with the shipped model models/pneunet/pneunet.twin; about four minutes:
    softtwin-studies bench
  Another model, for a script, with a picture of the distributions:
    softtwin-studies bench --model finger.twin --json --picture latency.svg
  What the parameters of a model cost, beside a model without:
    softtwin-studies bench --model models/pneunet-design/pneunet-design.twin \\
      --plain models/pneunet/pneunet.twin
  The whole field at 1 kHz, by each way to wait:
    softtwin-studies bench --rates-hz 1000 --payloads all --seconds 20
  Computation only, no processes:
    softtwin-studies bench --no-live

All columns of a table are measured in turn inside one loop, so that a disturbance hits all of them: trust ratios of one \
run, not figures of two runs. `evicted` walks through more memory than the caches hold before each call. The end-to-end \
rows start `softtwind bridge` and `softtwind twin` (expected beside this program) and read in this third process; the \
latency runs from the reading's stamp in the bridge to the field in the reader's hands. The ways to wait, of twin and reader:
Event (asleep until woken), EventAwake (realtime.stay_awake), BusyPoll (spinning all the time); `core` is the processor time of each, in % of one core. \
Use a release build: cargo build --release -p softtwin -p studies";

/// Measure kernel, prediction and the way from sensor to reader on this machine.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Model to measure; the shipped models/pneunet/pneunet.twin when left out.
    #[arg(long, value_name = "FILE.twin")]
    model: Option<PathBuf>,
    /// Instead: the cost of the whole field compared with that of this model without parameters.
    #[arg(long, value_name = "FILE.twin", requires = "model", conflicts_with_all = ["picture", "no_live"])]
    plain: Option<PathBuf>,
    /// Measure a synthetic model of full size instead: 25,022 nodes, 6 modes per field.
    #[arg(long, conflicts_with = "model", help_heading = "Selection")]
    synthetic: bool,
    /// Samples of each computation (10 to 1000000).
    #[arg(long, value_name = "N", default_value_t = 2000, value_parser = softtwin::range::count(10, 1_000_000))]
    samples: usize,
    #[command(flatten)]
    rows: live::Rows,
    /// One JSON object on standard output.
    #[arg(long, help_heading = "Output")]
    json: bool,
    /// Write the distributions as a picture.
    #[arg(long, value_name = "FILE.svg|png", help_heading = "Output")]
    picture: Option<PathBuf>,
}

/// The default model.
const SHIPPED: &str = "models/pneunet/pneunet.twin";

impl Args {
    /// Measures and prints.
    pub fn run(self) -> anyhow::Result<()> {
        let mut progress = Progress::new(false);
        progress.step("preparing the model");
        let (name, model) = if self.synthetic {
            ("synthetic, 6 modes per field".into(), full_size::model()?)
        } else {
            let path = self.model.map_or_else(|| shared_files::find(SHIPPED), Ok)?;
            (path.display().to_string(), files::model(&path)?)
        };
        if let Some(plain) = &self.plain {
            let comparison = comparison::run(&model, &files::model(plain)?, self.samples)?;
            drop(progress);
            return if self.json { output::json(&comparison) } else { comparison.print() };
        }
        let (compute, mut series) = compute::run(&model, self.samples, &mut progress)?;
        let rows = if self.rows.no_live { Vec::new() } else { live::run(&model, &self.rows, &mut progress)? };
        drop(progress);
        let (mut end_to_end, mut notes) = (Vec::new(), Vec::new());
        for row in rows {
            match row {
                Ok((row, distribution)) => {
                    end_to_end.push(row);
                    series.push(distribution);
                }
                Err(note) => notes.push(note),
            }
        }
        if let Some(path) = &self.picture {
            picture::draw(path, &series)?;
        }
        let report = report::Report { model: name, compute, end_to_end, notes };
        if self.json { output::json(&report) } else { report.print() }
    }
}
