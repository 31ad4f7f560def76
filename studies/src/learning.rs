//! States against error: models trained on more and more of a database's training states, with and without derivatives.

use anyhow::Context;
use formats::database::{self, ObstacleKind};
use rom::config::TrainConfig;
use rom::evaluate::{DEFAULT_FLOOR, Summary, evaluate};
use rom::snapshots::{Database, Split};
use rom::train::train;
use serde_json::json;
use softtwin::output;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
    softtwin-studies learning --database mine
    softtwin-studies learning --database mine --shares 0.25,0.5,1

Training states are taken evenly from the list of cases; errors are those of all test and check states, which no training sees.";

/// Show what more training states, and their derivatives, are worth.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// Database folder with states of split test or check.
    #[arg(long, value_name = "DIR")]
    database: PathBuf,
    /// Shares of the training states.
    #[arg(long, value_delimiter = ',', default_values_t = [0.25, 0.35, 0.5, 0.7, 1.0])]
    shares: Vec<f64>,
    /// Print JSON lines instead of a table.
    #[arg(long)]
    json: bool,
}

/// The database with a share of its training states; the others take part in nothing.
fn thinned(database: &Database, share: f64) -> (Database, usize) {
    let mut thin = database.clone();
    let train: Vec<usize> = database.of_split(Split::Train).collect();
    let taken = |k: usize| ((k + 1) as f64 * share).floor() > (k as f64 * share).floor();
    for (_, &case) in train.iter().enumerate().filter(|(k, _)| !taken(*k)) {
        thin.cases[case].split = Split::Check;
    }
    let count = thin.of_split(Split::Train).count();
    (thin, count)
}

impl Args {
    /// Trains and evaluates.
    ///
    /// # Errors
    /// A database without unseen states, or a training that fails.
    pub fn run(self) -> anyhow::Result<()> {
        let database = database::read(&self.database, ObstacleKind::Plate)?;
        let unseen: Vec<usize> =
            (0..database.cases.len()).filter(|&i| database.cases[i].split != Split::Train).collect();
        anyhow::ensure!(!unseen.is_empty(), "the database has no test or check states to judge by");
        let config = TrainConfig { full_leave_one_out: false, ..TrainConfig::default() };
        if !self.json {
            output!(
                "{:>7} {:<12} {:<8} {:>22} {:>22} {:>22}",
                "states",
                "derivatives",
                "regime",
                "coordinates % mean/95",
                "stress % mean/95",
                "force % mean/95"
            )?;
        }
        for share in &self.shares {
            let (thin, states) = thinned(&database, *share);
            let plain = Database { sensitivities: None, ..thin.clone() };
            let with = thin.sensitivities.is_some().then_some(("with", &thin));
            for (derivatives, database) in [Some(("without", &plain)), with].into_iter().flatten() {
                let trained = train(database, &config, &mut |_| {});
                let (model, _) =
                    trained.with_context(|| format!("{states} states, {derivatives} derivatives"))?;
                for summary in evaluate(&model, database, &unseen, DEFAULT_FLOOR)?.regimes {
                    self.print(states, derivatives, &summary)?;
                }
            }
        }
        Ok(())
    }

    fn print(&self, states: usize, derivatives: &str, summary: &Summary) -> anyhow::Result<()> {
        let worst = |names: &[&str]| {
            let of =
                summary.fields.iter().filter(|f| names.contains(&f.field.as_str())).map(|f| f.normalised);
            of.fold([0.0_f64; 2], |most, n| [most[0].max(100.0 * n[0]), most[1].max(100.0 * n[1])])
        };
        let (coordinates, stress) = (worst(&["x", "y", "z"]), worst(&["von_mises"]));
        let force = [100.0 * summary.force_normalised[0], 100.0 * summary.force_normalised[1]];
        if self.json {
            return Ok(output::json(&json!({
                "states": states, "derivatives": derivatives == "with", "regime": summary.regime.name(),
                "unseen": summary.cases, "coordinates_percent": coordinates, "stress_percent": stress,
                "force_percent": force, "coverage": summary.coverage }))?);
        }
        let pair = |v: [f64; 2]| format!("{:.3} / {:.3}", v[0], v[1]);
        output!(
            "{states:>7} {derivatives:<12} {:<8} {:>22} {:>22} {:>22}",
            summary.regime.name(),
            pair(coordinates),
            pair(stress),
            pair(force)
        )?;
        Ok(())
    }
}
