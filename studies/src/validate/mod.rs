//! `softtwin-studies validate`: the finite elements against everything that is known about the reference actuator.

mod abaqus_arrays;
mod agreement;
mod book;
mod commercial;
mod discretisation;
mod published;
mod refinement;

use book::Book;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  Everything: published figures, node by node against the commercial solver, mesh refinement (minutes):
    softtwin-studies validate
  Only the published figures on the actuator's own mesh:
    softtwin-studies validate --only published
  Node by node, with further cases of the shared database, by number:
    softtwin-studies validate --only commercial --cases 10 22 34 70 124 141
  The whole actuator on its own mesh and on a finer one (an hour, 6 GB); only when asked for:
    scripts/mesh.py models/pneunet/actuator.toml --finer 1.8 --out target/finer.msh
    softtwin-studies validate --only discretisation
  As one JSON object:
    softtwin-studies validate --json";

const NOTES: &str = "\
The commercial mesh and result are not part of the project: they are looked for in --shared, and where they are absent
the command says so and leaves that part out. Ends with 1 when a figure misses its bound.";

/// Compare the finite elements with published figures, with the commercial solver node by node, and with finer meshes.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES, after_help = NOTES)]
pub struct Args {
    /// Parts to run; when left out all but the discretisation.
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
    /// Finer mesh of the whole actuator.
    #[arg(long, value_name = "FILE.msh", default_value = "target/finer.msh")]
    finer_mesh: PathBuf,
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
    /// The whole actuator on a finer mesh.
    Discretisation,
}

impl Args {
    /// Runs the parts and says whether every figure holds.
    pub fn run(self) -> anyhow::Result<()> {
        let mut book = Book::new(self.json);
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
        if self.only.contains(&Part::Discretisation) {
            discretisation::run(&self.actuator, &self.finer_mesh, &mut book)?;
        }
        book.close()
    }
}
