//! `softtwin import`: meshes of other programs as VTU.

use crate::failure::usage;
use crate::files::refusal;
use crate::output;
use anyhow::Result;
use formats::abaqus;
use formats::vtu::{self, Block, Cells, Grid};
use serde_json::json;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  softtwin import finger.inp --out finger.vtu
  softtwin import finger.msh --out finger.vtu --json

From Abaqus: nodes, second-order tetrahedra (C3D10...) and hexahedra (C3D20...), shells and membranes (S3, S4, STRI65,
S8R, M3D...); any other element is refused by its name. From gmsh (.msh 4.1) and VTK (.vtu): 10-node tetrahedra.
Snapshots need no import: `softtwin train --database DIR` reads our layout, the authors' tables (authors.toml) and the
exchange of Ansys' static reduced-order models (folders with settings.json, points.bin, doe.csv, snapshots/) as they are.";

/// Import a mesh (.inp, .msh, .vtu) as a .vtu file.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// The mesh.
    #[arg(value_name = "FILE")]
    mesh: PathBuf,
    /// File to write.
    #[arg(long, value_name = "FILE.vtu")]
    out: PathBuf,
    /// End with one JSON object.
    #[arg(long)]
    json: bool,
}

impl Args {
    /// Reads, writes, and says what was found.
    ///
    /// # Errors
    /// What is wrong with the mesh, line by line; a file that cannot be written.
    pub fn run(self) -> Result<()> {
        if self.out.extension().is_none_or(|ending| ending != "vtu") {
            return Err(usage(format!(
                "--out: expected a name that ends in .vtu, found {}",
                self.out.display()
            )));
        }
        let is_abaqus = self.mesh.extension().is_some_and(|ending| ending == "inp");
        let (points, blocks) = if is_abaqus {
            let mesh = abaqus::read(&self.mesh).map_err(refusal)?;
            let blocks = mesh.blocks();
            (mesh.points, blocks)
        } else {
            let mesh = formats::read_mesh(&self.mesh).map_err(refusal)?;
            let nodes = mesh.tets.as_flattened().to_vec();
            (mesh.points_mm, vec![Block { kind: 24, nodes_per_cell: 10, nodes }])
        };
        let grid = Grid { points_mm: &points, cells: Cells::Mixed(&blocks), point_data: &[] };
        vtu::write(&self.out, &grid).map_err(refusal)?;
        let counts: Vec<(String, usize)> = blocks.iter().map(|block| (name(block), count(block))).collect();
        if self.json {
            let cells: serde_json::Map<_, _> = counts.into_iter().map(|(name, n)| (name, json!(n))).collect();
            return output::json(&json!({ "out": self.out, "nodes": points.len(), "cells": cells }));
        }
        let cells: Vec<String> = counts.iter().map(|(name, count)| format!("{count} {name}")).collect();
        output!("{}: {} nodes, {}", self.out.display(), points.len(), cells.join(", "))?;
        Ok(())
    }
}

fn count(block: &Block) -> usize {
    block.nodes.len() / block.nodes_per_cell
}

fn name(block: &Block) -> String {
    let shape = match block.kind {
        24 => "tetrahedra",
        25 => "hexahedra",
        5 | 22 => "triangles",
        _ => "quadrilaterals",
    };
    format!("{}-node {shape}", block.nodes_per_cell)
}
