//! `softtwin evaluate`.

mod found;
mod sealed;
mod traces;

use crate::options::ObstacleArg;
use crate::{files, output, report};
use formats::database::ObstacleKind;
pub use found::picture;
use found::{CaseRow, Printed, PrintedEvaluation, leave_one_out};
use rom::model::Model;
use rom::snapshots::{Database, Split};
use std::path::{Path, PathBuf};
use train::evaluate::{EvaluationReport, evaluate};

const EXAMPLES: &str = "\
Examples:
  The paper's test cases, which training does not use:
    softtwin evaluate finger.twin --database models/pneunet/database
  All held-out states, as JSON, with a picture:
    softtwin evaluate finger.twin \\
      --database models/pneunet/database --split held-out --json \\
      --picture errors.svg
  Sealed evaluation: 200 states over the whole training range, 10 % of them free, simulated, evaluated once and deleted:
    softtwin evaluate models/pneunet/pneunet.twin --sealed 200 \\
      --seed 20261122
  Errors on 300 more such states, by which training then sets the half-widths:
    softtwin evaluate finger.twin --actuator finger/actuator.toml \\
      --sealed 300 --seed 31 --errors errors.csv
    softtwin train --database finger/database --errors errors.csv \\
      --out finger.twin
  A model with inertia along motions of the finite elements, and the same model without:
    softtwin simulate --actuator finger/actuator.toml --trace step.csv --out step
    softtwin evaluate finger.twin --traces step --picture step.svg

Normalised: largest error over nodes by the field's largest value in that case. Relative: Eq. (16) with the floor, a fraction \
of the field's largest value, because stress is exactly 0 at some nodes. Truncation: what the modes cannot represent; \
interpolation: what the kernels get wrong within the modes. Along motions: root mean square errors in % of a quantity's range, of positions \
in % of the length of the tip's range, the contact force as mean over 10 ms; coverage: values within their half-widths, %.";

/// Say how far a model is from the finite elements it stands for: its errors on states and motions that it has not seen.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Model file.
    #[arg(value_name = "FILE.twin")]
    model: PathBuf,
    /// Database folder of the same actuator and mesh.
    #[arg(long, value_name = "DIR", required_unless_present_any = ["sealed", "traces"], conflicts_with = "sealed")]
    database: Option<PathBuf>,
    /// Number of states to draw over the whole training range, 10 % of them free, simulate into the system's folder for temporary
    /// files, evaluate on and remove.
    #[arg(long, value_name = "N", requires = "seed", conflicts_with = "split", value_parser = clap::value_parser!(u64).range(10..=10_000), help_heading = "Sampling")]
    sealed: Option<u64>,
    /// Folders of motions with their series.csv, written by `softtwin simulate --trace`.
    #[arg(long, value_name = "DIR", num_args = 1.., conflicts_with_all = ["database", "sealed", "split", "errors"])]
    traces: Vec<PathBuf>,
    /// Seed of the random states.
    #[arg(long, value_name = "N", requires = "sealed", help_heading = "Computing")]
    seed: Option<u64>,
    /// Actuator that is simulated [default: actuator.toml in the model's folder].
    #[arg(long, value_name = "FILE.toml", requires = "sealed")]
    actuator: Option<PathBuf>,
    /// States simulated at the same time; about 1 GB each (1 to 256).
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = crate::range::threads, help_heading = "Computing")]
    threads: usize,
    /// Cases to evaluate on; when left out those of split test, or of check where there are none.
    #[arg(long, value_enum, help_heading = "Sampling")]
    split: Option<SplitArg>,
    /// Obstacle of the cases.
    #[arg(long, value_enum, default_value_t)]
    obstacle: ObstacleArg,
    /// Picture of the errors by case, or of the motions with phase and spectrum: .svg or .png.
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    picture: Option<PathBuf>,
    /// Table of the errors of every state inside the training range, for `softtwin train --errors`.
    #[arg(long, value_name = "FILE.csv", help_heading = "Output")]
    errors: Option<PathBuf>,
    /// Print one JSON object instead of text.
    #[arg(long, help_heading = "Output")]
    json: bool,
}

/// Cases to evaluate on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum SplitArg {
    /// The paper's test cases.
    Test,
    /// Further states, some outside the training range.
    Check,
    /// Test and check cases.
    HeldOut,
    /// The training cases themselves: what is left is truncation.
    Train,
    /// Every case.
    All,
}

impl SplitArg {
    fn has(self, split: Split) -> bool {
        match self {
            Self::Test => split == Split::Test,
            Self::Check => split == Split::Check,
            Self::HeldOut => split != Split::Train,
            Self::Train => split == Split::Train,
            Self::All => true,
        }
    }
}

impl Args {
    /// Evaluates and prints.
    pub fn run(self) -> anyhow::Result<()> {
        let model = files::model(&self.model)?;
        if !self.traces.is_empty() {
            return traces::run(&model, &self.traces, self.picture.as_deref(), self.json);
        }
        if let Some(count) = self.sealed {
            return self.sealed(&model, count as usize);
        }
        let folder = self.database.as_deref().unwrap_or(Path::new(""));
        let database = files::database(folder, ObstacleKind::from(self.obstacle))?;
        let split = match self.split {
            Some(split) => split,
            None if database.of_split(Split::Test).next().is_some() => SplitArg::Test,
            None => SplitArg::Check,
        };
        if self.errors.is_some() && split.has(Split::Train) {
            return Err(crate::failure::usage(
                "--errors: expected held-out states, found training states among them; name --split check, test or held-out",
            ));
        }
        let cases: Vec<usize> =
            (0..database.cases.len()).filter(|i| split.has(database.cases[*i].split)).collect();
        if cases.is_empty() {
            return Err(crate::failure::usage(format!(
                "--split: {} has no such cases; it has {}. Hold states back (split check in its list of cases), take new ones \
                 (--sealed 12 --seed 1), or use those trained on (--split train)",
                folder.display(),
                splits(&database)
            )));
        }
        self.show(&model, &evaluate(&model, &database, &cases)?)
    }

    fn show(&self, model: &Model, report: &EvaluationReport) -> anyhow::Result<()> {
        if let Some(path) = &self.errors {
            train::unseen_errors::write(path, model, &report.cases).map_err(files::refusal)?;
        }
        let left_out = leave_one_out(&self.model);
        if let Some(path) = &self.picture {
            picture(report).save(path)?;
        }
        if self.json {
            return output::json(&Printed { report, leave_one_out: left_out });
        }
        let cases = report.cases.iter().map(CaseRow::of).collect();
        report::print(
            &PrintedEvaluation {
                floor: report.floor,
                regimes: &report.regimes,
                cases,
                leave_one_out: left_out,
            },
            false,
        )
    }
}

fn splits(database: &Database) -> String {
    let count = |split| database.of_split(split).count();
    format!("{} train, {} test, {} check", count(Split::Train), count(Split::Test), count(Split::Check))
}
