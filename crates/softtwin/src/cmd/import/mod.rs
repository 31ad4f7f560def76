//! `softtwin import`: meshes of other programs as VTU, and their finished simulations as a database.

mod found;
mod results;

use crate::failure::usage;
use crate::files::refusal;
use crate::report;
use anyhow::Result;
use fem::BodyReport;
use formats::cells::{Block, CellKind};
use formats::vtu::{self, Cells, Grid};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  softtwin import finger.inp --out finger.vtu
  softtwin import finger.msh --out finger.vtu --json
  softtwin import results run_*.frd --out database --length-unit mm \\
    --stress-unit mpa --inputs inputs.csv

From Abaqus: nodes, tetrahedra (C3D4, C3D10...), hexahedra (C3D8, C3D20...) and wedges (C3D6, C3D15...), shells and membranes \
(S3, S4, STRI65, S8R, M3D...); any other element is refused by its name. \
From gmsh (.msh 4.1): 10-node tetrahedra. From VTK (.vtu): all these and pyramids. Other formats: softtwin-convert of the Python client. \
Finished simulations: `softtwin import results --help`. No import is needed for what `softtwin train --database DIR` reads as \
it is: our layout and the authors' tables (authors.toml).";

/// Import a mesh (.inp, .msh, .vtu) as a .vtu file, or finished simulations as a database.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES, args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Args {
    #[command(subcommand)]
    what: Option<What>,
    /// The mesh.
    #[arg(value_name = "FILE", required = true)]
    mesh: Option<PathBuf>,
    /// File to write.
    #[arg(long, value_name = "FILE.vtu", required = true)]
    out: Option<PathBuf>,
    /// End with one JSON object.
    #[arg(long)]
    json: bool,
}

#[derive(clap::Subcommand)]
enum What {
    Results(results::Args),
}

/// A mesh that was written.
#[derive(Serialize)]
struct ImportedMesh {
    out: PathBuf,
    nodes: usize,
    /// Number of cells of each kind.
    cells: BTreeMap<String, usize>,
    left_out: Vec<String>,
    body: BodyReport,
}

impl Args {
    /// Reads, writes, and says what was found.
    ///
    /// # Errors
    /// Errors in the mesh, by line; a file that cannot be written.
    pub fn run(self) -> Result<()> {
        if let Some(What::Results(results)) = self.what {
            return results.run();
        }
        let (Some(mesh), Some(out)) = (self.mesh, self.out) else {
            return Err(usage("expected a mesh and --out"));
        };
        if out.extension().is_none_or(|ending| ending != "vtu") {
            return Err(usage(format!("--out: expected a name that ends in .vtu, found {}", out.display())));
        }
        let (points, blocks, left_out) = formats::read_blocks(&mesh).map_err(refusal)?;
        let grid = Grid { points_mm: &points, cells: Cells::Mixed(&blocks), point_data: &[] };
        vtu::write(&out, &grid).map_err(refusal)?;
        let cells = blocks.iter().map(|block| (name(block), block.count())).collect();
        let body = BodyReport::of(&points, &blocks);
        report::print(&ImportedMesh { out, nodes: points.len(), cells, left_out, body }, self.json)
    }
}

/// `10-node tetrahedra`.
fn name(block: &Block) -> String {
    let shape = CellKind::of(block.kind.into()).map_or("cells", |kind| kind.shape);
    format!("{}-node {shape}", block.nodes_per_cell)
}
