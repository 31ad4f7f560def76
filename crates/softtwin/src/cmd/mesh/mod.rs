//! `softtwin mesh`: a mesh of an actuator without a mesher, the parts of a mesh file, or the mesh of a CAD file.

mod step;

use crate::failure::usage;
use crate::files::{not_gridded, refusal};
use crate::report;
use fem::actuator::{Actuator, NamedPart, mesh_quality};
use fem::{BodyReport, Mesh};
use serde::Serialize;
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

/// Whether a named surface is to take a pressure.
fn is_cavity(part: &NamedPart) -> bool {
    !part.is_volume && (part.name == "cavity" || part.name.starts_with("cavity."))
}

/// A mesh, and of a mesh file its named parts.
#[derive(Serialize)]
struct MeshReport {
    mesh: PathBuf,
    nodes: usize,
    tetrahedra: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    quality: Option<Quality>,
    #[serde(skip_serializing_if = "Option::is_none")]
    parts: Option<Vec<NamedPart>>,
    body: BodyReport,
}

/// Shape of the tetrahedra, 1 for regular ones.
#[derive(Serialize)]
struct Quality {
    least: f64,
    mean: f64,
}

/// The body of an actuator, with remarks on what cannot be.
fn body(actuator: &Actuator, mesh: &Mesh) -> BodyReport {
    let mut body = BodyReport::of_tets(&mesh.nodes_mm, &mesh.tets);
    body.want_hollow();
    body.check_rubber(actuator.elastomer.law.shear_modulus_mpa());
    body
}

/// The named parts of a mesh file and its size; an error says what is missing, after the parts that there are.
fn check(actuator: &Actuator, path: &Path, as_json: bool) -> anyhow::Result<()> {
    let parts = actuator.inventory(path).map_err(refusal)?;
    let mesh = match actuator.read_mesh(path) {
        Ok(mesh) => mesh,
        Err(error) => {
            if !as_json {
                report::print(&parts, false)?;
            }
            return Err(refusal(error));
        }
    };
    let mut body = body(actuator, &mesh);
    for part in parts.iter().filter(|part| is_cavity(part) && part.encloses_mm3.is_none()) {
        body.remark(format!(
            "surface {} is not closed: it takes no pressure; it must have all walls of its hollow",
            part.name
        ));
    }
    let (least, mean) = mesh_quality(&mesh, &mesh.nodes_mm);
    let found = MeshReport {
        mesh: actuator.mesh_path(path),
        nodes: mesh.nodes_mm.len(),
        tetrahedra: mesh.tets.len(),
        quality: Some(Quality { least, mean }),
        parts: Some(parts),
        body,
    };
    report::print(&found, as_json)
}

impl Args {
    /// Meshes, checks, writes.
    pub fn run(self) -> anyhow::Result<()> {
        let Some(path) = &self.actuator else {
            return self.cad.run(self.size_mm, self.out.as_deref(), self.json);
        };
        let actuator = Actuator::read(path).map_err(refusal)?;
        if actuator.shape().is_none() {
            return check(&actuator, path, self.json);
        }
        let out = self.out.clone().unwrap_or_else(|| actuator.mesh_path(path));
        if out.extension().is_none_or(|e| e != "vtu") {
            return Err(usage(format!(
                "{}: expected a file name with the ending .vtu; give --out or set mesh.file",
                out.display()
            )));
        }
        let mesh = actuator.write_grid(self.size_mm, &out).map_err(not_gridded)?;
        let (nodes, tetrahedra, mut body) = (mesh.nodes_mm.len(), mesh.tets.len(), body(&actuator, &mesh));
        if actuator.mesh.nodes != 0 && actuator.mesh.nodes != nodes {
            let wanted = actuator.mesh.nodes;
            body.remark(format!("{} wants {wanted} nodes: set mesh.nodes = 0", path.display()));
        }
        report::print(
            &MeshReport { mesh: out, nodes, tetrahedra, quality: None, parts: None, body },
            self.json,
        )
    }
}
