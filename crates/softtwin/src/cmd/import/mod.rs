//! `softtwin import`: meshes of other programs as VTU, and their finished simulations as a database.

mod inputs;
mod results;

use crate::cmd::mesh::body::BodyReport;
use crate::failure::usage;
use crate::files::refusal;
use crate::output;
use anyhow::Result;
use formats::cells::{Block, Kind};
use formats::vtu::{self, Cells, Grid};
use serde_json::json;
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
        let body = BodyReport::of(&points, &blocks);
        let counts: Vec<(String, usize)> = blocks.iter().map(|block| (name(block), block.count())).collect();
        if self.json {
            let cells: serde_json::Map<_, _> = counts.into_iter().map(|(name, n)| (name, json!(n))).collect();
            return output::json(
                &json!({ "out": out, "nodes": points.len(), "cells": cells, "left_out": left_out, "body": body.json() }),
            );
        }
        let cells: Vec<String> = counts.iter().map(|(name, count)| format!("{count} {name}")).collect();
        output!("{}: {} nodes, {}", out.display(), points.len(), cells.join(", "))?;
        left_out.iter().try_for_each(|what| output!("left out: {what}"))?;
        body.print()
    }
}

/// `10-node tetrahedra`.
fn name(block: &Block) -> String {
    let shape = Kind::of(block.kind.into()).map_or("cells", |kind| kind.shape);
    format!("{}-node {shape}", block.nodes_per_cell)
}
