//! Mesh of a CAD file through gmsh's Python package, with a picture of each named part.

use crate::failure::{configuration, usage};
use crate::files::refusal;
use crate::picture::camera::Camera;
use crate::picture::canvas::Canvas;
use crate::picture::colour::ColourMap;
use crate::picture::scale::Scale;
use crate::picture::scene::Scene;
use crate::picture::sheet::{Panel, Row, Sheet};
use crate::picture::skin::DrawnBody;
use crate::picture::theme::ThemeName;
use crate::{range, report};
use anyhow::Context;
use fem::BodyReport;
use formats::cells::{Block, surface};
use formats::mesh_file::{MeshFile, TRI_FACETS};
use formats::msh;
use serde::Serialize;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::Command;

/// The script that is run: one JSON object of options in, one of figures out.
const SCRIPT: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../scripts/step.py"));
/// Panels of a row, and their width.
const COLUMNS: usize = 3;
const PANEL_PX: usize = 420;

/// Options of a CAD file.
#[derive(clap::Args)]
pub struct Cad {
    /// CAD file in place of --actuator: solids, in any unit that the file states.
    #[arg(long, value_name = "FILE.step", conflicts_with = "actuator", help_heading = "CAD file")]
    step: Option<PathBuf>,
    /// Named surface: NAME=xmin, xmax, ymin, ymax, zmin or zmax (the plane end), outer, or face numbers (3+5). Closed inner walls are
    /// `cavity`, `cavity.2`, ...
    #[arg(long, value_name = "NAME=FACES", value_parser = face, requires = "step", help_heading = "CAD file")]
    face: Vec<(String, String)>,
    /// Elements through a wall where it is thinner than the element size allows.
    #[arg(long, value_name = "N", default_value_t = 2.0, value_parser = range::number(0.5, 10.0), help_heading = "CAD file")]
    through: f64,
    /// Python that has the package gmsh.
    #[arg(long, value_name = "PROGRAM", default_value = "python3", help_heading = "CAD file")]
    python: PathBuf,
}

fn face(text: &str) -> Result<(String, String), String> {
    let pair = text.split_once('=').filter(|(name, faces)| !name.is_empty() && !faces.is_empty());
    let expected = || format!("expected NAME=FACES, such as clamp=xmin, found {text:?}");
    pair.map(|(name, faces)| (name.to_owned(), faces.to_owned())).ok_or_else(expected)
}

/// The mesh of a CAD file; names and actuator.toml: docs/own-mesh.md.
#[derive(Serialize)]
struct CadReport<'a> {
    mesh: &'a Path,
    nodes: usize,
    picture: PathBuf,
    volumes: Vec<String>,
    surfaces: Vec<String>,
    /// What the script says of faces, cavities and quality.
    report: Value,
    body: BodyReport,
}

impl Cad {
    /// Meshes the file, prints the quality and all faces, draws the named parts.
    ///
    /// # Errors
    /// No Python package gmsh, a file without solids, unknown faces; I/O errors.
    pub fn run(&self, size_mm: f64, out: Option<&Path>, as_json: bool) -> anyhow::Result<()> {
        let out = out.filter(|out| out.extension().is_some_and(|ending| ending == "msh"));
        let (Some(step), Some(out)) = (&self.step, out) else {
            return Err(usage("--out: expected a file name with the ending .msh for the mesh of --step"));
        };
        if let Some(folder) = out.parent() {
            std::fs::create_dir_all(folder)
                .with_context(|| format!("{}: the folder cannot be made", folder.display()))?;
        }
        let options = json!({"step": step, "out": out, "size_mm": size_mm, "through": self.through, "faces": self.face});
        let program = self.python.display();
        let run = Command::new(&self.python).args(["-c", SCRIPT, &options.to_string()]).output();
        let run = run.with_context(|| format!("--python {program}: the program cannot be started"))?;
        if !run.status.success() {
            let error = String::from_utf8_lossy(&run.stderr);
            if error.contains("ModuleNotFoundError") {
                let remedy =
                    format!("{program} -m pip install gmsh numpy, or --python with one that has them");
                return Err(configuration(anyhow::anyhow!(
                    "{program} has no package gmsh or numpy: {remedy}"
                )));
            }
            let last = error.lines().last().unwrap_or_default();
            return Err(configuration(anyhow::anyhow!("{}: {last}", step.display())));
        }
        let text = String::from_utf8_lossy(&run.stdout);
        let figures: Value = serde_json::from_str(text.lines().last().unwrap_or_default())
            .with_context(|| format!("{program}: no figures were printed"))?;
        let mesh = msh::read(out).map_err(refusal)?;
        let picture = out.with_extension("png");
        draw(&mesh, &out.display().to_string())?.write_png(&picture)?;
        let mut body = BodyReport::of_tets(&mesh.points_mm, &mesh.tets);
        body.want_hollow();
        body.compare(figures["volume_mm3"].as_f64());
        report::print(
            &CadReport {
                mesh: out,
                nodes: mesh.points_mm.len(),
                picture,
                volumes: mesh.volumes.keys().cloned().collect(),
                surfaces: mesh.surfaces.keys().cloned().collect(),
                report: figures,
                body,
            },
            as_json,
        )
    }
}

/// One panel per named part, all with the same view.
fn draw(mesh: &MeshFile, title: &str) -> anyhow::Result<Canvas> {
    let nodes: Vec<[f32; 3]> = mesh.points_mm.iter().map(|p| p.map(|v| v as f32)).collect();
    let volumes = mesh.volumes.iter().map(|(name, elements)| {
        let cells: Vec<u32> = elements.iter().flat_map(|e| mesh.tets[*e as usize]).collect();
        let block = Block { kind: 24, nodes_per_cell: 10, nodes: cells };
        (format!("volume {name}"), surface(&mesh.points_mm, &[block]))
    });
    let surfaces = mesh.surfaces.iter().map(|(name, triangles)| {
        let facets = triangles.iter().flat_map(|t| TRI_FACETS.map(|facet| facet.map(|k| t[k])));
        (format!("surface {name}"), facets.collect())
    });
    let body = |facets| DrawnBody { nodes_mm: nodes.clone(), facets, values: vec![0.5; nodes.len()] };
    let bodies: Vec<(String, DrawnBody)> =
        volumes.chain(surfaces).map(|(name, facets)| (name, body(facets))).collect();
    let rows = bodies.chunks(COLUMNS).map(|chunk| Row {
        heading: String::new(),
        panels: chunk
            .iter()
            .map(|(name, body)| Panel {
                scene: Scene { body, plate: None, blocks: &[], range: [0.0, 1.0] },
                title: name.clone(),
                note: String::new(),
            })
            .collect(),
    });
    let sheet = Sheet {
        title: title.into(),
        caption: "Named parts, each alone.".into(),
        rows: rows.collect(),
        bar_label: String::new(),
        scale: Scale::new([0.0, 1.0], 1),
        map: ColourMap::stress(),
        camera: Camera::new(24.0, 17.0),
        panel_px: PANEL_PX,
        text_px: 21.0,
        theme: ThemeName::Light.colours(),
    };
    sheet.draw()
}
