//! `softtwin-studies validate`: the finite elements against everything that is known about the reference actuator.

mod abaqus_arrays;
mod agreement;
mod commercial;
mod published;
mod refinement;

use fem::Problem;
use fem::actuator::Actuator;
use serde::Serialize;
use serde_json::json;
use softtwin::failure::configuration;
use softtwin::files::refusal;
use softtwin::output;
use std::path::{Path, PathBuf};
use std::sync::Arc;

const EXAMPLES: &str = "\
Examples:
  Everything: published figures, node by node against the commercial solver, mesh refinement (minutes):
    softtwin-studies validate
  Only the published figures on the actuator's own mesh:
    softtwin-studies validate --only published
  Node by node, with further cases of the shared database, by number:
    softtwin-studies validate --only commercial --cases 10 22 34 70 124 141
  As one JSON object:
    softtwin-studies validate --json

The commercial mesh and result are not part of the project: they are looked for in --shared, and where they are absent
the command says so and leaves that part out. Ends with 1 when a figure misses its bound.";

/// Compare the finite elements with published figures, with the commercial solver node by node, and with finer meshes.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// Parts to run; all when left out.
    #[arg(long, value_enum, value_name = "PART", num_args = 1..)]
    only: Vec<Part>,
    /// The reference actuator.
    #[arg(long, value_name = "FILE.toml", default_value = "models/pneunet/actuator.toml")]
    actuator: PathBuf,
    /// The gripper's finger.
    #[arg(long, value_name = "FILE.toml", default_value = "models/gripper/actuator.toml")]
    gripper: PathBuf,
    /// Folder with `reference/` (commercial mesh and result) and `database/` (states recomputed on that mesh).
    #[arg(long, value_name = "DIR", default_value = "../shared")]
    shared: PathBuf,
    /// Cases of the shared database to recompute, by number.
    #[arg(long, value_name = "N", num_args = 1.., default_values_t = [10, 22, 34, 70, 124])]
    cases: Vec<usize>,
    /// Meshes of the refinement study: into how many parts each box of the coarsest grid is divided along each axis.
    #[arg(long, value_name = "N", num_args = 2.., default_values_t = [1, 2, 3], value_parser = softtwin::range::count(1, 20))]
    times: Vec<usize>,
    /// Chambers of the refinement study.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = softtwin::range::count(1, 1000))]
    chambers: usize,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

/// Parts of the comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Part {
    /// Figures the paper publishes, on the actuator's own mesh.
    Published,
    /// Node by node on the commercial solver's mesh.
    Commercial,
    /// The same state on finer and finer meshes.
    Refinement,
}

impl Args {
    /// Runs the parts and says whether every figure holds.
    pub fn run(self) -> anyhow::Result<()> {
        let mut book = Book { rows: Vec::new(), quiet: self.json, skipped: Vec::new() };
        let wanted = |part| self.only.is_empty() || self.only.contains(&part);
        if wanted(Part::Published) {
            published::run(&self.actuator, &self.gripper, &mut book)?;
        }
        if wanted(Part::Commercial) {
            commercial::run(&self.shared, &self.cases, &mut book)?;
        }
        if wanted(Part::Refinement) {
            refinement::run(&self.actuator, self.chambers, &self.times, &mut book)?;
        }
        book.close()
    }
}

/// One comparison.
#[derive(Debug, Serialize)]
struct Row {
    part: &'static str,
    quantity: String,
    computed: f64,
    reference: f64,
    /// Error in the bound's unit.
    error: f64,
    bound: f64,
    unit: &'static str,
    holds: bool,
}

/// All comparisons, printed as they come.
struct Book {
    rows: Vec<Row>,
    skipped: Vec<String>,
    quiet: bool,
}

impl Book {
    fn heading(&self, text: &str) -> anyhow::Result<()> {
        if !self.quiet {
            output!("\n{text}")?;
            output!(
                "{:<50} {:>11} {:>11} {:>10} {:>9}",
                "quantity",
                "computed",
                "reference",
                "error",
                "at most"
            )?;
        }
        Ok(())
    }

    fn remark(&self, text: &str) -> anyhow::Result<()> {
        if !self.quiet {
            output!("{text}")?;
        }
        Ok(())
    }

    fn skip(&mut self, text: String) -> anyhow::Result<()> {
        self.remark(&format!("\nskipped: {text}"))?;
        self.skipped.push(text);
        Ok(())
    }

    /// A figure whose relative error, in per cent, has a bound.
    fn relative(
        &mut self,
        part: &'static str,
        quantity: String,
        (computed, reference): (f64, f64),
        bound: f64,
    ) -> anyhow::Result<()> {
        let error = 100.0 * (computed / reference - 1.0);
        self.add(Row { part, quantity, computed, reference, error, bound, unit: "%", holds: false })
    }

    /// An error that stands for itself.
    fn absolute(
        &mut self,
        part: &'static str,
        quantity: String,
        error: f64,
        (bound, unit): (f64, &'static str),
    ) -> anyhow::Result<()> {
        self.add(Row { part, quantity, computed: error, reference: 0.0, error, bound, unit, holds: false })
    }

    fn add(&mut self, mut row: Row) -> anyhow::Result<()> {
        row.holds = row.error.abs() <= row.bound;
        if !self.quiet {
            output!(
                "{:<50} {:>11.5} {:>11.5} {:>+8.4} {:<2} {:>6} {}{}",
                row.quantity,
                row.computed,
                row.reference,
                row.error,
                row.unit,
                (row.bound * 1.0e4).round() / 1.0e4, // a bound in N as a share of a force has no end
                row.unit,
                if row.holds { "" } else { "  MISSED" }
            )?;
        }
        self.rows.push(row);
        Ok(())
    }

    fn close(self) -> anyhow::Result<()> {
        let missed: Vec<&str> = self.rows.iter().filter(|r| !r.holds).map(|r| r.quantity.as_str()).collect();
        if self.quiet {
            output::json(&json!({"rows": self.rows, "missed": missed.len(), "skipped": self.skipped}))?;
        } else {
            output!("\n{} figures compared, {} missed", self.rows.len(), missed.len())?;
        }
        if missed.is_empty() {
            return Ok(());
        }
        anyhow::bail!(
            "{} of {} figures miss their bound: {}",
            missed.len(),
            self.rows.len(),
            missed.join(", ")
        )
    }
}

/// An actuator and its problem on its own mesh.
fn open(path: &Path) -> anyhow::Result<(Actuator, Arc<Problem>)> {
    let actuator = Actuator::read(path).map_err(refusal)?;
    let mesh = actuator.read_mesh(path).map_err(refusal)?;
    let problem = Problem::new(mesh, actuator.problem_config()).map_err(configuration)?;
    Ok((actuator, Arc::new(problem)))
}

fn largest(values: &[f64]) -> f64 {
    values.iter().copied().fold(0.0, f64::max)
}
