//! `softtwin mesh`: a mesh of an actuator without a mesher, the parts of a mesh file, or the mesh of a CAD file.

pub mod body;
mod step;

use crate::failure::usage;
use crate::files::refusal;
use crate::output;
use anyhow::Context;
use body::{BodyReport, place, rounded};
use fem::Mesh;
use fem::actuator::{Actuator, NamedPart, mesh_quality};
use formats::vtu;
use serde_json::json;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  Three chambers instead of eleven: copy the reference, set chambers.count = 3, body.length_mm = 31, base.length_mm = 43, \
  mesh.file = \"mesh.vtu\" and mesh.nodes = 0, then
    cp models/pneunet/actuator.toml short.toml
    softtwin mesh --actuator short.toml --size-mm 4
    softtwin simulate --actuator short.toml --pressure 0.05 --out state.vtu
  What size gives how many nodes:
    softtwin mesh --actuator short.toml --size-mm 2 --out fine.vtu

  The named parts of a mesh file, and what is missing:
    softtwin mesh --actuator bender/actuator.toml
  A CAD file through gmsh (pip install gmsh numpy), the face at its smallest x named `clamp`, and a picture of each named part:
    softtwin mesh --step part.step --face clamp=xmin --size-mm 3 --out bender/mesh.msh

Planes through all faces divide the actuator into boxes, each split into six tetrahedra. scripts/mesh.py uses gmsh instead:
fewer elements for the same accuracy. An actuator without base, body and chambers has the shape of its mesh.file: that file is checked.";

/// Mesh an actuator with second-order tetrahedra on a grid, or check its mesh file.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Geometry, materials, loads, supports and mesh, such as models/pneunet/actuator.toml.
    #[arg(long, value_name = "FILE.toml", required_unless_present = "step")]
    actuator: Option<PathBuf>,
    #[command(flatten)]
    cad: step::Cad,
    /// Longest edge of a box in mm.
    #[arg(long, value_name = "MM", default_value_t = 9.0, value_parser = crate::range::number(1e-3, 1e6))]
    size_mm: f64,
    /// The .vtu to write; default: the mesh.file of the actuator. With --step the .msh.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

/// Meshes an actuator on a grid into a `.vtu` file; returns the mesh.
///
/// # Errors
/// The size does not suit the actuator; I/O errors.
pub fn write_grid(actuator: &Actuator, size_mm: f64, out: &Path) -> anyhow::Result<Mesh> {
    let mesh = actuator.grid_mesh(size_mm, 1).map_err(|list| {
        let list: Vec<String> = list.iter().map(ToString::to_string).collect();
        usage(format!("--size-mm: {}", list.join("\n  ")))
    })?;
    let cells = vtu::Cells::QuadraticTets(&mesh.tets);
    vtu::write(out, &vtu::Grid { points_mm: &mesh.nodes_mm, cells, point_data: &[] })
        .context("the mesh was not written")?;
    Ok(mesh)
}

/// Whether a named surface is to take a pressure.
fn is_cavity(part: &NamedPart) -> bool {
    !part.is_volume && (part.name == "cavity" || part.name.starts_with("cavity."))
}

impl Args {
    /// Prints the named parts of a mesh file, then its size, or what is missing.
    fn check(&self, actuator: &Actuator, path: &Path) -> anyhow::Result<()> {
        let parts = actuator.inventory(path).map_err(refusal)?;
        if !self.json {
            for part in &parts {
                let (what, elements, unit) = match part.is_volume {
                    true => ("volume", "tetrahedra", "mm3"),
                    false => ("surface", "triangles", "mm2"),
                };
                let role = part.role.as_deref().unwrap_or("not used");
                output!(
                    "{what:<8} {:<24} {:>7} {elements:<10} {:>10.1} {unit}  {role}",
                    part.name,
                    part.elements,
                    part.size
                )?;
                if let (true, Some(centre_mm)) = (is_cavity(part), part.centre_mm) {
                    let holds =
                        part.encloses_mm3.map_or("open".into(), |mm3| format!("holds {} mm3", rounded(mm3)));
                    output!("         {:<24} {holds}, centre {}", "", place(centre_mm))?;
                }
            }
        }
        let mesh = actuator.read_mesh(path).map_err(refusal)?;
        let mut body = self.body(actuator, &mesh);
        for part in parts.iter().filter(|part| is_cavity(part) && part.encloses_mm3.is_none()) {
            body.remark(format!(
                "surface {} is not closed: it takes no pressure; it must have all walls of its hollow",
                part.name
            ));
        }
        let (nodes, tets) = (mesh.nodes_mm.len(), mesh.tets.len());
        let (least, mean) = mesh_quality(&mesh, &mesh.nodes_mm);
        if self.json {
            let parts: Vec<_> = parts
                .iter()
                .map(|part| {
                    json!({"name": part.name, "volume": part.is_volume, "elements": part.elements, "size": part.size, "role": part.role,
                        "centre_mm": part.centre_mm, "encloses_mm3": part.encloses_mm3})
                })
                .collect();
            return output::json(&json!({
                "mesh": actuator.mesh_path(path), "nodes": nodes, "tetrahedra": tets, "parts": parts,
                "quality": {"least": least, "mean": mean}, "body": body.json(),
            }));
        }
        output!("{nodes} nodes, {tets} tetrahedra, quality {least:.3} at least, {mean:.3} in the mean")?;
        body.print()
    }

    /// The body of an actuator, with remarks on what cannot be.
    fn body(&self, actuator: &Actuator, mesh: &Mesh) -> BodyReport {
        let mut body = BodyReport::of_tets(&mesh.nodes_mm, &mesh.tets);
        body.want_hollow();
        body.check_rubber(actuator.elastomer.law.shear_modulus_mpa());
        body
    }

    /// Meshes, checks, writes.
    pub fn run(self) -> anyhow::Result<()> {
        let Some(path) = &self.actuator else {
            return self.cad.run(self.size_mm, self.out.as_deref(), self.json);
        };
        let actuator = Actuator::read(path).map_err(refusal)?;
        if actuator.shape().is_none() {
            return self.check(&actuator, path);
        }
        let beside = || actuator.mesh_path(path);
        let out = self.out.clone().unwrap_or_else(beside);
        if out.extension().is_none_or(|e| e != "vtu") {
            return Err(usage(format!(
                "{}: expected a file name with the ending .vtu; give --out or set mesh.file",
                out.display()
            )));
        }
        let mesh = write_grid(&actuator, self.size_mm, &out)?;
        let (nodes, tets, body) = (mesh.nodes_mm.len(), mesh.tets.len(), self.body(&actuator, &mesh));
        if self.json {
            return output::json(
                &json!({"mesh": out, "nodes": nodes, "tetrahedra": tets, "body": body.json()}),
            );
        }
        output!("{}: {nodes} nodes, {tets} tetrahedra", out.display())?;
        body.print()?;
        if actuator.mesh.nodes != 0 && actuator.mesh.nodes != nodes {
            output!("{} wants {} nodes: set mesh.nodes = 0", path.display(), actuator.mesh.nodes)?;
        }
        Ok(())
    }
}
