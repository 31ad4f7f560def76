//! `softtwin sample`: lists of cases to simulate, and cases where a trained model is least sure.

mod refine;

use crate::failure::usage;
use crate::files::{self, not_planned, save};
use crate::report;
use fem::cases::to_csv;
use fem::plan::{List, ListRegime, Onset, Parameter, Sampling, check_corners};
use formats::database::ObstacleKind;
use refine::{Refinement, Target};
use serde::Serialize;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  A space-filling Latin hypercube over pressure and gap:
    softtwin sample --kind hypercube --n 85 --regime contact --out cases.csv
  States over pressure, gap and two parameters of the actuator, every fourth without the plate:
    softtwin sample --kind sequence --n 100 --regime both \\
      --actuator actuator.toml --parameter elastomer.law.mu_mpa=0.6:1.0 \\
      --parameter base.lower_mm=1.6:2.4 --out design.csv
  36 designs, each with four free states and six that touch (--database supplies the nominal contact onset):
    softtwin sample --kind sequence --n 36 --states-per-design 10 \\
      --regime both --database models/pneunet/database \\
      --actuator actuator.toml --parameter elastomer.law.mu_mpa=0.6:1.0 \\
      --parameter base.lower_mm=1.6:2.4 --out designs.csv
  Seventeen pressures for the free regime:
    softtwin sample --kind hypercube --n 17 --regime free --out free.csv
  A grid of 10 pressures by 9 gaps:
    softtwin sample --kind grid --n 10 --n-gaps 9 --regime contact \\
      --out grid.csv
  States on the onset of contact, read off the free states of a database:
    softtwin sample --kind onset --n 20 --database database --out onset.csv
  The same over a parameter of a database that has it:
    softtwin sample --kind onset --n 20 --database design \\
      --actuator actuator.toml --parameter base.lower_mm=1.6:2.4 --out onset.csv
  Then:
    softtwin simulate --actuator actuator.toml --cases cases.csv --out database
  Eight more states where the model trained on a database is least sure: simulated, added, retrained, compared:
    softtwin sample --refine 8 --database models/pneunet/database \\
      --actuator models/pneunet/actuator.toml --out refined

Refinement picks, one after another, the state with the largest product of the nearest sample's leave-one-out error (by the \
model's half-widths) and the distance to it. It writes a database folder with the trained model in it; stopped and \
started again it continues.";

/// How states are chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum SampleKind {
    /// Latin hypercube, space-filling (maximin).
    Hypercube,
    /// Low-discrepancy sequence: every first part of the list fills the space too.
    Sequence,
    /// Full grid, bounds included.
    Grid,
    /// Points along the onset of contact.
    Onset,
}

/// Regimes a list can be for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Regime {
    /// Pressure alone.
    Free,
    /// Pressure and gap, over a plate.
    Contact,
    /// Pressure and gap, before a block.
    Gripper,
    /// Pressure and gap over a plate; every fourth state free.
    Both,
}

impl From<Regime> for ListRegime {
    fn from(regime: Regime) -> Self {
        match regime {
            Regime::Free => Self::Free,
            Regime::Contact => Self::Contact,
            Regime::Gripper => Self::Gripper,
            Regime::Both => Self::Both,
        }
    }
}

/// Splits a list can be for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Split {
    /// Training looks at them.
    Train,
    /// Evaluation only.
    Check,
}

/// Choose states to simulate: Latin hypercubes, grids, points on the onset of contact.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// How states are chosen.
    #[arg(long, value_enum, required_unless_present = "refine", help_heading = "Sampling")]
    kind: Option<SampleKind>,
    /// Number of states; of a grid: number of pressures (1 to 100000).
    #[arg(long, value_name = "N", required_unless_present = "refine", value_parser = crate::range::count(1, MAX_STATES), help_heading = "Sampling")]
    n: Option<usize>,
    /// Number of gaps of a grid.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = crate::range::count(1, MAX_STATES), help_heading = "Sampling")]
    n_gaps: usize,
    /// --n counts designs (sets of parameters), each with this number of states: four free, the rest with the obstacle (6 to 100).
    #[arg(long, value_name = "N", requires = "parameter", value_parser = crate::range::count(6, 100), help_heading = "Sampling")]
    states_per_design: Option<usize>,
    /// Regime of the states.
    #[arg(long, value_enum, default_value = "contact", help_heading = "Sampling")]
    regime: Regime,
    /// Purpose of the states.
    #[arg(long, value_enum, default_value = "train", help_heading = "Sampling")]
    split: Split,
    /// Lower and upper pressure in MPa.
    #[arg(long = "pressure", value_name = "MPA", num_args = 2, default_values_t = [0.0, 0.09], value_parser = crate::range::pressure_mpa, help_heading = "State")]
    pressure_mpa: Vec<f64>,
    /// Lower and upper gap in mm.
    #[arg(long = "gap", value_name = "MM", num_args = 2, default_values_t = [10.0, 50.0], value_parser = crate::range::gap_mm, help_heading = "State")]
    gap_mm: Vec<f64>,
    /// A parameter and its range: dotted key of actuator.toml, such as elastomer.law.mu_mpa=0.6:1.0. Not of a grid.
    #[arg(long, value_name = "NAME=LOW:HIGH", requires = "actuator", group = "simulated", value_parser = clap::value_parser!(Parameter), help_heading = "State")]
    parameter: Vec<Parameter>,
    /// Seed of the hypercube or the sequence.
    #[arg(long, value_name = "N", default_value_t = 1, help_heading = "Computing")]
    seed: u64,
    /// Database whose free states give the onset of contact, or which is refined; with --states-per-design, states that surely
    /// touch are chosen by it.
    #[arg(long, value_name = "DIR", required_if_eq("kind", "onset"))]
    database: Option<PathBuf>,
    /// First part of the cases' names; when left out it says kind, regime and purpose, so that lists can be joined.
    #[arg(long, value_name = "NAME", help_heading = "Sampling")]
    prefix: Option<String>,
    /// The list: case,regime,split,pressure_mpa,gap_mm and a column for each parameter. Of a refinement: the new database's folder.
    #[arg(long, value_name = "FILE.csv|DIR", help_heading = "Output")]
    out: PathBuf,
    #[command(flatten)]
    refinement: Refinement,
}

/// A list that was written.
#[derive(Serialize)]
struct ListReport<'a> {
    out: &'a Path,
    cases: usize,
}

/// More states than this would take months to simulate.
const MAX_STATES: usize = 100_000;

impl Args {
    /// Chooses and writes the list.
    pub fn run(self) -> anyhow::Result<()> {
        if let (true, Some(database)) = (self.refinement.is_wanted(), &self.database) {
            let (out, regime, seed) = (self.out.as_path(), self.regime.into(), self.seed);
            return self.refinement.run(&Target { database, out, regime, seed });
        }
        let (Some(kind), Some(n)) = (self.kind, self.n) else {
            return Err(usage("expected --kind and --n, or --refine with --database"));
        };
        if n.saturating_mul(self.n_gaps) > MAX_STATES {
            let found = format!("{n} x {}", self.n_gaps);
            return Err(usage(format!("--n, --n-gaps: expected 1 to {MAX_STATES} states, found {found}")));
        }
        if !self.parameter.is_empty() {
            if kind == SampleKind::Grid {
                return Err(usage("--parameter: expected --kind hypercube, sequence or onset"));
            }
            let family = files::family(self.refinement.actuator.as_deref().unwrap_or(Path::new("")))?;
            check_corners(&family, &self.parameter).map_err(not_planned)?;
        }
        let prefix = self.prefix.clone().unwrap_or_else(|| self.own_prefix(kind));
        let list = List {
            parameters: &self.parameter,
            count: n,
            loads: [bounds("--pressure", &self.pressure_mpa, 0.0)?, bounds("--gap", &self.gap_mm, 1e-6)?],
            prefix: &prefix,
            split: if self.split == Split::Train { "train" } else { "check" },
            seed: self.seed,
        };
        let cases = match self.states_per_design {
            Some(_) if kind != SampleKind::Sequence || self.regime != Regime::Both => {
                return Err(usage("--states-per-design: expected --kind sequence and --regime both"));
            }
            Some(states) => list.designs(states, self.known_onset()?),
            None => list.cases(self.regime.into(), self.sampling(kind)?),
        };
        let cases = cases.map_err(not_planned)?;
        save(&self.out, to_csv(&cases).as_bytes())?;
        report::print(&ListReport { cases: cases.len(), out: &self.out }, false)
    }

    fn sampling(&self, kind: SampleKind) -> anyhow::Result<Sampling> {
        Ok(match kind {
            SampleKind::Hypercube => Sampling::Hypercube,
            SampleKind::Sequence => Sampling::Sequence,
            SampleKind::Grid => Sampling::Grid { gaps: self.n_gaps },
            SampleKind::Onset if self.regime == Regime::Free => {
                return Err(usage("--kind onset: expected --regime contact or gripper, found free"));
            }
            SampleKind::Onset => Sampling::Onset(
                self.known_onset()?.ok_or_else(|| usage("--kind onset: expected --database"))?,
            ),
        })
    }

    fn known_onset(&self) -> anyhow::Result<Option<Onset>> {
        let Some(path) = &self.database else { return Ok(None) };
        let names: Vec<&str> = self.parameter.iter().map(|p| p.name.as_str()).collect();
        Onset::of(&files::database(path, ObstacleKind::Plate)?, &names).map(Some).map_err(not_planned)
    }

    /// `free`, `contact-grid`, `contact-check` and so on.
    fn own_prefix(&self, kind: SampleKind) -> String {
        let way = match kind {
            SampleKind::Grid => "-grid",
            SampleKind::Onset => "-onset",
            SampleKind::Sequence => "-sequence",
            SampleKind::Hypercube => "",
        };
        let purpose = if self.split == Split::Check { "-check" } else { "" };
        format!("{}{way}{purpose}", ListRegime::from(self.regime).name())
    }
}

fn bounds(name: &str, range: &[f64], least: f64) -> anyhow::Result<[f64; 2]> {
    match range {
        [low, high] if *low >= least && high > low && high.is_finite() => Ok([*low, *high]),
        _ => Err(usage(format!("{name}: expected {least} <= lower < upper, found {range:?}"))),
    }
}
