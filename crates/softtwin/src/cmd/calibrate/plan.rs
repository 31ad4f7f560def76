//! `softtwin calibrate --plan`.

use crate::report;
use crate::unknowns::Unknowns;
use runtime::estimation::experiment::{Experiment, ExperimentPlan};
use serde::Serialize;

/// What an experiment may vary.
#[derive(clap::Args)]
#[command(next_help_heading = "Plan of an experiment")]
pub struct PlanArgs {
    /// Before measuring: which holds and sensors would tell the unknowns apart, with the standard deviations to expect.
    #[arg(long, conflicts_with_all = ["recording", "log", "topic", "out", "memory", "force", "picture"])]
    pub plan: bool,
    /// Lowest and highest pressure; default: the range of the model.
    #[arg(long = "pressure", requires = "plan", num_args = 2, value_names = ["LOW", "HIGH"], value_parser = crate::range::pressure_mpa)]
    pressure_mpa: Option<Vec<f64>>,
    /// Places of the plate; default: the prior of the gap, or the scene's gap.
    #[arg(long = "gap", requires = "plan", num_args = 1.., value_name = "MM", value_parser = crate::range::gap_mm)]
    gap_mm: Vec<f64>,
    /// Holds to choose (1 to 20).
    #[arg(long, requires = "plan", value_name = "N", default_value_t = 4, value_parser = crate::range::count(1, 20))]
    holds: usize,
    /// Readings at each hold (1 to 1000000).
    #[arg(long, requires = "plan", value_name = "N", default_value_t = 200, value_parser = crate::range::count(1, 1_000_000))]
    readings: usize,
}

/// What the command found: a plan for each choice of sensors, fewest sensors first.
#[derive(Serialize)]
struct Plans {
    readings_per_hold: usize,
    unknowns: usize,
    /// Position of the first plan that identifies everything.
    recommended: Option<usize>,
    plans: Vec<ExperimentPlan>,
}

impl PlanArgs {
    /// Chooses, then prints one plan for each set of sensors.
    pub fn run(self, unknowns: Unknowns, json: bool) -> anyhow::Result<()> {
        let experiment = Experiment {
            spec: &unknowns.spec,
            header: &unknowns.header,
            setup: unknowns.setup.at_rest(),
            sensors: unknowns.sensors,
            pressure_mpa: self.pressure_mpa.as_deref().and_then(|range| range.try_into().ok()),
            gaps_mm: &self.gap_mm,
            holds: self.holds,
            readings: self.readings,
        };
        let unknowns = experiment.setup.unknowns.len();
        let plans = experiment.plans()?;
        let recommended = plans.iter().position(|plan| plan.identifiable);
        let found = Plans { readings_per_hold: self.readings, unknowns, recommended, plans };
        report::print(&found, json)
    }
}
