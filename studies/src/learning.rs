//! States against error: trained on more and more of the states, with and without their derivatives.

use anyhow::Context;
use formats::database::ObstacleKind;
use rom::hull::DomainStatus;
use rom::model::Model;
use rom::snapshots::{Database, RegimeKind, Split};
use softtwin::progress::Progress;
use softtwin::{files, output, range};
use std::fmt::Write as _;
use std::path::PathBuf;
use train::config::{ModeChoice, TrainConfig};
use train::evaluate::{Summary, evaluate};
use train::train;

const EXAMPLES: &str = "\
Examples:
    scripts/make_model.sh design
    softtwin-studies learning --model models/pneunet-design/pneunet-design.twin --database target/database/design
  On new states, simulated for it:
    softtwin evaluate models/pneunet/pneunet.twin --actuator models/pneunet/actuator.toml \\
      --simulate 400 --seed 7 --database target/unseen
    softtwin-studies learning --model models/pneunet/pneunet.twin --database models/pneunet/database \\
      --unseen target/unseen --fractions 1";

const NOTES: &str = "\
Errors are on the contact states of the split `check` inside the model's domain: mean / 95th percentile. Training is that of
`softtwin train` with every mode that lowers the leave-one-out error; the states are taken evenly from the list.";

/// Train on parts of a database's states, with and without derivatives, and measure the errors on held-out states.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES, after_help = NOTES)]
pub struct Args {
    /// Database with derivatives.
    #[arg(long, value_name = "DIR")]
    database: PathBuf,
    /// Database of the same mesh with the states of the split `check` that errors are measured on; --database when left out.
    #[arg(long, value_name = "DIR")]
    unseen: Option<PathBuf>,
    /// Model whose domain is taken.
    #[arg(long, value_name = "FILE.twin")]
    model: PathBuf,
    /// Shares of the training states, each 0.01 to 1.
    #[arg(long, value_name = "SHARE", num_args = 1.., default_values_t = [0.33, 0.67, 1.0], value_parser = range::number(0.01, 1.0))]
    fractions: Vec<f64>,
}

impl Args {
    /// Trains, measures, prints a table.
    pub fn run(self) -> anyhow::Result<()> {
        let mut progress = Progress::new(false);
        progress.step("reading the database");
        let database = files::database(&self.database, ObstacleKind::Plate)?;
        let further =
            self.unseen.as_ref().map(|folder| files::database(folder, ObstacleKind::Plate)).transpose()?;
        let unseen = Unseen::inside(&files::model(&self.model)?, further.as_ref().unwrap_or(&database))?;
        anyhow::ensure!(
            !unseen.cases.is_empty(),
            "{}: expected contact states of the split `check` inside the model's domain, found none",
            self.unseen.as_ref().unwrap_or(&self.database).display()
        );
        let points = curve(&database, &unseen, &self.fractions, &mut |step| progress.step(step))?;
        drop(progress);
        output!("{} unseen states\n\n{}", unseen.cases.len(), table(&points))?;
        Ok(())
    }
}

/// Held-out contact states.
pub struct Unseen<'a> {
    /// Where they are.
    pub database: &'a Database,
    /// Which of its cases.
    pub cases: Vec<usize>,
}

impl<'a> Unseen<'a> {
    /// Those of the split `check` inside the model's training range.
    fn inside(model: &Model, database: &'a Database) -> anyhow::Result<Self> {
        let contact = |i: &usize| database.cases[*i].regime == RegimeKind::Contact;
        let cases: Vec<usize> = database.of_split(Split::Check).filter(contact).collect();
        let report = evaluate(model, database, &cases)?;
        let inside = cases.iter().zip(&report.cases).filter(|(_, case)| case.domain == DomainStatus::Inside);
        Ok(Self { database, cases: inside.map(|(i, _)| *i).collect() })
    }
}

/// Displacement, stress and force: mean and 95th percentile over the unseen states.
pub type Errors = [[f64; 2]; 3];

/// Result of training on a number of states.
pub struct Point {
    pub states: usize,
    pub with_derivatives: bool,
    pub errors: Errors,
}

/// Errors on `unseen` states after training on fractions of the training states.
///
/// # Errors
/// A fraction on which no model can be trained.
pub fn curve(
    database: &Database,
    unseen: &Unseen,
    fractions: &[f64],
    notify: &mut dyn FnMut(&str),
) -> anyhow::Result<Vec<Point>> {
    let config = as_many_modes_as_pay();
    let mut points = Vec::new();
    for fraction in fractions {
        let (with, states) = thinned(database, *fraction);
        let without = Database { sensitivities: None, ..with.clone() };
        for (with_derivatives, part) in [(true, &with), (false, &without)] {
            let name = if with_derivatives { "with" } else { "without" };
            notify(&format!("states against error: {states} states, {name} derivatives"));
            let model =
                train(part, &config, &mut |_| {}).with_context(|| format!("{states} states, {name}"))?.0;
            let report = evaluate(&model, unseen.database, &unseen.cases)?;
            if let Some(summary) = report.regimes.first() {
                points.push(Point { states, with_derivatives, errors: errors(summary) });
            }
        }
    }
    Ok(points)
}

/// As `softtwin train`, with every mode that lowers the leave-one-out error: what is compared is what the states know, not how
/// much of it is kept.
fn as_many_modes_as_pay() -> TrainConfig {
    let mut config = TrainConfig::default();
    for regime in [&mut config.free, &mut config.contact] {
        (regime.modes, regime.max_modes) = (ModeChoice::LeaveOneOut(1.0), usize::MAX);
    }
    config
}

/// The points as a table of percentages, and what derivatives are worth where all states take part.
pub fn table(points: &[Point]) -> String {
    let mut text = String::from(
        "| states | derivatives | displacement | stress | force |\n| --- | --- | --- | --- | --- |\n",
    );
    for point in points {
        let cells = point.errors.map(|[mean, p95]| format!("{:.4} / {:.4}", 100.0 * mean, 100.0 * p95));
        let name = if point.with_derivatives { "with" } else { "without" };
        let _ = writeln!(text, "| {} | {name} | {} |", point.states, cells.join(" | "));
    }
    text + &worth(points)
}

/// Mean errors with derivatives over those without, from the most states.
fn worth(points: &[Point]) -> String {
    let most = points.iter().map(|point| point.states).max();
    let of = |with| points.iter().find(|p| Some(p.states) == most && p.with_derivatives == with);
    let (Some(with), Some(without)) = (of(true), of(false)) else { return String::new() };
    let [displacement, stress, force] = [0, 1, 2].map(|k| with.errors[k][0] / without.errors[k][0]);
    format!(
        "\nFrom {} states, mean errors with derivatives over those without: displacement {displacement:.2}, stress \
         {stress:.2}, force {force:.2}.\n",
        with.states
    )
}

/// Database with a fraction of its training states, taken evenly from the list; the others are unused.
fn thinned(database: &Database, fraction: f64) -> (Database, usize) {
    let mut thin = database.clone();
    let taken = |k: usize| ((k + 1) as f64 * fraction).floor() > (k as f64 * fraction).floor();
    let train: Vec<usize> = database.of_split(Split::Train).collect();
    for (_, &case) in train.iter().enumerate().filter(|(k, _)| !taken(*k)) {
        thin.cases[case].split = Split::Check;
    }
    let count = thin.of_split(Split::Train).count();
    (thin, count)
}

fn errors(summary: &Summary) -> Errors {
    let field = |name: &str| {
        let found = summary.fields.iter().find(|field| field.field == name);
        found.map_or([f64::NAN; 2], |field| [field.normalised[0], field.normalised[1]])
    };
    [field("displacement"), field("von_mises"), [summary.force_normalised[0], summary.force_normalised[1]]]
}

#[cfg(test)]
mod tests {
    use super::{Point, table};

    fn point(states: usize, with_derivatives: bool, means: [f64; 3]) -> Point {
        Point { states, with_derivatives, errors: means.map(|mean| [mean, 3.0 * mean]) }
    }

    #[test]
    fn value_of_derivatives_follows_from_both_fits() {
        let few = [point(50, true, [9e-4, 9e-3, 9e-4]), point(50, false, [1e-3, 1e-2, 1e-3])];
        let all = [point(154, true, [6e-5, 1.6e-3, 4e-5]), point(154, false, [1.2e-4, 3.2e-3, 1e-4])];
        let text = table(&few.into_iter().chain(all).collect::<Vec<_>>());
        assert!(
            text.contains("| 154 | with | 0.0060 / 0.0180 | 0.1600 / 0.4800 | 0.0040 / 0.0120 |\n"),
            "{text}"
        );
        let said = "From 154 states, mean errors with derivatives over those without: displacement 0.50, stress 0.50, force 0.40.\n";
        assert!(text.ends_with(said), "{text}");
    }

    #[test]
    fn missing_fit_gives_no_value_of_derivatives() {
        let text =
            table(&[point(50, true, [1e-4; 3]), point(50, false, [2e-4; 3]), point(154, true, [1e-5; 3])]);
        assert!(text.ends_with(" |\n") && !text.contains("over those without"), "{text}");
    }
}
