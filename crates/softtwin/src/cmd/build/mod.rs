//! `softtwin build`: from the geometry, or from an imported database, to a twin that can be started, in one command.

mod folder;
mod imported;
mod infill;
mod plan;
mod pressures;
mod quality;
mod scene;

use super::mesh::write_grid;
use super::simulate::batch;
use super::simulate::section::Bending;
use crate::failure::{configuration, usage};
use crate::files::{self, quoted, refusal, save};
use crate::progress::Doing;
use crate::{output, range, resources};
use anyhow::Result;
use fem::Family;
use fem::actuator::Actuator;
use fem::cases::{Case, to_csv};
use fem::run::{Run, Store, fingerprint};
use folder::{Folder, OwnConfig};
use plan::{Budget, Counts, Plan, landings};
use pressures::Pressures;
use quality::Quality;
use rom::model::PressureLimit;
use serde_json::json;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;
use train::config::{Definition, ObservableKind, Place};

const EXAMPLES: &str = "\
Example: a first look at a new finger, then the twin for use
  softtwin new finger6 --chambers 6 --length-mm 100
  softtwin build finger6 --quick
  softtwin build finger6
A twin of another program's results:
  softtwin import results jobs/*.frd --inputs inputs.csv \\
    --length-unit mm --stress-unit mpa --out part/database
  softtwin build part

Reads DIR/actuator.toml. Makes the mesh, finds the pressures that suit the actuator, simulates free and touching states, \
trains, measures the model on states it was not trained on, and writes a scene. Solved states are kept: stopped and started \
again it continues, also with the states of --quick. Without actuator.toml it takes DIR/database unchanged: trains, \
measures, writes a scene that replays a sweep of the first input.";

/// Make a twin from DIR/actuator.toml (mesh, states, model, its errors, scene), or from DIR/database.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Folder with actuator.toml (`softtwin new` makes one) or database (`softtwin import results`).
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// A first look: fewer states, and more where the errors ask for them only while all takes less than 200 s of processor time. How
    /// good the model is, is printed.
    #[arg(long)]
    quick: bool,
    /// Longest edge of an element in mm; mesh.size_mm of actuator.toml when left out.
    #[arg(long, value_name = "MM", value_parser = range::number(1e-3, 1e6), help_heading = "Computing")]
    size_mm: Option<f64>,
    /// States solved at the same time; about 1 GB each on a fine mesh (1 to 256).
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = range::threads, help_heading = "Computing")]
    threads: usize,
    /// End with one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

/// The mesh file that this command makes; one of another name is the user's.
const OWN_MESH: &str = "mesh.vtu";
/// Longest edge of an element by the thinnest wall of a chamber: elements that are longer and flatter fold before they bend.
const COARSEST: f64 = 5.0;

/// Farthest that the nearest node may be from a point of an observable (mm), as the model's own limit is.
const NEAR_MM: f64 = 4.0;

/// Observables of every actuator: its bending angles and the place of its tip. Of a finger also the angle of its chord, in place of the
/// tip's z, and the volume of its chambers.
fn observables(family: &Family) -> BTreeMap<String, Definition> {
    let problem = &family.problem;
    let of = |kind, points, axis| Definition { kind, points, axis };
    let mut all: BTreeMap<String, Definition> = Bending::all(family)
        .into_iter()
        .map(|bending| (bending.name.to_owned(), bending.definition(problem)))
        .collect();
    let shape = family.actuator.shape();
    let tip = match &shape {
        Some(shape) => Place::At([shape.base.length_mm, shape.base_mm(), 0.0]),
        None => tip_place(family),
    };
    let axes = [("tip_x_mm", [1.0, 0.0, 0.0]), ("tip_y_mm", [0.0, 1.0, 0.0]), ("tip_z_mm", [0.0, 0.0, 1.0])];
    for (name, axis) in axes.into_iter().take(if shape.is_some() { 2 } else { 3 }) {
        all.insert(name.into(), of(ObservableKind::Position, vec![tip.clone()], Some(axis)));
    }
    if let Some(shape) = shape {
        let chord = vec![Place::At([0.0, shape.base_mm(), 0.0]), tip];
        all.insert("chord_angle_deg".into(), of(ObservableKind::ChordAngle, chord, None));
        all.insert("chamber_volume_mm3".into(), of(ObservableKind::Volume, Vec::new(), None));
    }
    all
}

/// The centroid of the end face; where that is in a hole, or far from every node, the mean of the face's nodes.
fn tip_place(family: &Family) -> Place {
    let mesh = family.problem.mesh();
    let end = mesh.end_face();
    let distance = |x: &[f64; 3]| x.iter().zip(end.centroid_mm).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
    let is_near = mesh.nodes_mm.iter().any(|x| distance(x) <= NEAR_MM * NEAR_MM);
    if end.is_solid && is_near { Place::At(end.centroid_mm) } else { Place::Set("tip".into()) }
}

impl Args {
    /// Builds and says how good the twin is and how it is started.
    ///
    /// # Errors
    /// The actuator cannot be built or solved, with what to change; I/O errors.
    pub fn run(self) -> Result<()> {
        let began = Instant::now();
        let path = self.folder.join("actuator.toml");
        let database = self.folder.join("database");
        let folder = Folder { path: &self.folder, json: self.json };
        if !path.is_file() {
            if imported::is_database(&database) {
                return imported::build(&folder, &database);
            }
            let (name, folder, database) = (self.folder.display(), quoted(&self.folder), quoted(&database));
            return Err(usage(format!(
                "{name}: expected a folder with actuator.toml, which `softtwin new {folder}` makes, or with an imported database: \
                 `softtwin import results ... --out {database}`"
            )));
        }
        let actuator = Actuator::read(&path).map_err(refusal)?;
        if let Some((file, material)) = Actuator::material(&path).map_err(refusal)? {
            folder.say("material", &format!("{}: {}", file.display(), material.summary()))?;
        }
        folder.say("mesh", &self.mesh(&actuator)?)?;
        let doing = Doing::default();
        let _heartbeat = doing.heartbeat();
        doing.begin("analysing the mesh");
        let family = files::family(&path)?;
        let actuator = &family.actuator;
        let pressures = self.pressures(&folder, &family, &doing)?;
        doing.end();
        let interval = material_interval(actuator, &pressures);
        if let Some([low, high]) = interval {
            let [softest, stiffest] = actuator.elastomer.shear_interval_mpa.unwrap_or([f64::NAN; 2]);
            folder.say(
                "material",
                &format!(
                    "no constants of this silicone were measured: {:.0} mm need anything from {low:.2e} to {high:.2e} MPa (shear modulus \
                     {softest} to {stiffest} MPa); a tension test narrows it most (softtwin material fit)",
                    pressures.displacement_mm
                ),
            )?;
        }
        let counts = if self.quick { Counts::QUICK } else { Counts::FULL };
        let mut plan = Plan::new(actuator, &pressures, counts)?;
        let options = batch::Options { threads: self.threads, sensitivities: false, settings: Vec::new() };
        if let (false, Some(gaps_mm)) = (plan.cavities.is_empty(), plan.gaps_mm) {
            let free: Vec<Case> = plan.cases.iter().filter(|case| case.gap_mm.is_none()).cloned().collect();
            let solved = batch::solve(&family, &free, &database, &options)?.solved;
            let (free, clearances_mm): (Vec<Case>, Vec<f64>) =
                solved.iter().map(|(at, solved)| (free[*at].clone(), solved.clearance_mm)).unzip();
            plan.cases.extend(landings(&free, &clearances_mm, gaps_mm));
        }
        let list = self.folder.join("cases.csv");
        save(&list, to_csv(&plan.cases).as_bytes())?;
        let gaps =
            plan.gaps_mm.map_or("no obstacle".into(), |[low, high]| format!("gaps {low} to {high} mm"));
        // States over the pressures of several cavities are a sample of the whole range; nothing is added to them.
        let further =
            if plan.cavities.is_empty() { counts.further } else { Budget { states: 0, cpu_s: 0.0 } };
        let more = match further.states {
            0 => String::new(),
            states => format!(", and at most {states} more where the errors ask for them"),
        };
        folder.say("states", &format!("{}{more}, in {}, {gaps}", plan.cases.len(), list.display()))?;
        let ranges =
            family.problem.config().elastomers.iter().filter_map(|elastomer| elastomer.stretch_range);
        let limit = PressureLimit {
            pressure_mpa: pressures.largest_mpa(),
            reason: pressures.reason.clone(),
            // Corners of the states found are stretched beyond the laws' range.
            stretch: ranges.map(|range| range[1]).fold(pressures.stretch.max(1.0), f64::max),
        };
        folder.save_config(&database, &OwnConfig { observables: observables(&family), limit })?;
        let outcome = infill::solve(&family, &mut plan, (&database, &options), further, |text| {
            // What a reader of the output misses when it is closed is a progress line.
            let _ = folder.say("states", text);
        })?;
        save(&list, to_csv(&plan.cases).as_bytes())?;
        let states = plan.cases.len();
        for (index, reason) in &outcome.failed {
            folder.say("left out", &format!("{}: {reason}", plan.cases[*index].name))?;
        }
        doing.begin("training");
        let (model, notes) = folder.train(&database, actuator.obstacle_kind(), &doing)?;
        doing.begin("measuring the model");
        let quality = Quality::of(&model, &database, &self.folder.join("errors.png"))?;
        let scene = self.folder.join("scene.toml");
        folder.save_scene(&scene, &scene::text(&family, &plan, &pressures))?;
        let seconds = began.elapsed().as_secs_f64();
        let cpu_s = resources::cpu_s("self");
        if self.json {
            return output::json(&json!({
                "model": model, "scene": scene, "notes": notes, "states": states, "failed": outcome.failed.len(),
                "reused": outcome.reused, "pressure_mpa": pressures.largest_mpa(), "pressure_reason": pressures.reason,
                "pressure_interval_mpa": interval, "largest_stretch": pressures.stretch,
                "displacement_mm": pressures.displacement_mm, "angle_deg": pressures.angle_deg, "contact_pressure_mpa": plan.contact_mpa, "gap_mm": plan.gaps_mm, "quality": quality, "seconds": seconds, "cpu_seconds": cpu_s,
            }));
        }
        quality.print()?;
        Quality::print_limits()?;
        quality.print_warnings(&match self.quick {
            true => format!("more states: softtwin build {}", quoted(&self.folder)),
            false => format!(
                "more states: softtwin sample --refine 8 --database {} --actuator {} --out finer",
                quoted(&database),
                quoted(&path)
            ),
        })?;
        self.commands(&model, &scene, &plan)?;
        output!("done in {seconds:.0} s, {:.0} s of processor time", cpu_s.unwrap_or(f64::NAN))?;
        Ok(())
    }

    /// Makes the mesh, unless the actuator names one of the user's own.
    fn mesh(&self, actuator: &Actuator) -> Result<String> {
        let file = self.folder.join(&actuator.mesh.file);
        if actuator.mesh.file != Path::new(OWN_MESH) {
            if self.size_mm.is_some() {
                return Err(usage(format!(
                    "--size-mm: the mesh is your own ({}); set mesh.file = \"{OWN_MESH}\" to have one made",
                    file.display()
                )));
            }
            return Ok(format!("{}, unchanged", file.display()));
        }
        let size = self.size_mm.unwrap_or(actuator.mesh.size_mm);
        let Some(wall) = actuator.thinnest_wall_mm() else {
            let expected =
                "another name: this one is made of base, body and chambers, which the actuator has not";
            return Err(configuration(anyhow::anyhow!("mesh.file: expected {expected}, found {OWN_MESH}")));
        };
        if size > COARSEST * wall {
            return Err(usage(format!(
                "mesh.size_mm (--size-mm): expected at most {:.1} mm, {COARSEST} times the thinnest wall of a chamber, found {size} mm; \
                 flatter elements fold before they bend. {:.1} mm suits this wall",
                COARSEST * wall,
                2.0 * wall
            )));
        }
        let mesh = write_grid(actuator, size, &file)?;
        let (nodes, tets) = (mesh.nodes_mm.len(), mesh.tets.len());
        Ok(format!(
            "{}: {nodes} nodes, {tets} elements of at most {size} mm (thinnest wall {wall:.2} mm)",
            file.display()
        ))
    }

    fn pressures(&self, folder: &Folder, family: &Family, doing: &Doing) -> Result<Pressures> {
        let store = Store::new(&self.folder.join("database/states"), fingerprint(&family.problem))?;
        let run = Run { family, store, threads: 1, sensitivities: false, searches_behind_limits: false };
        let found = pressures::find(&run, doing, |text| {
            // What a reader of the output misses when it is closed is a progress line.
            let _ = folder.say("pressures", text);
        })?;
        let largest = found.largest_mpa();
        folder.say(
            "pressures",
            &format!("0 to {largest} MPa, stretches to {:.2}: {}", found.stretch, found.reason),
        )?;
        Ok(found)
    }

    fn commands(&self, model: &Path, scene: &Path, plan: &Plan) -> Result<()> {
        let (model, scene) = (quoted(model), quoted(scene));
        let pressure = 0.7 * plan.contact_mpa;
        let gap = plan.gaps_mm.map_or(String::new(), |[a, b]| format!(" --gap {:.1}", 0.5 * (a + b)));
        let further = plan.cavities.iter().map(|name| format!(" --set {name}={:.4}", 0.5 * pressure));
        let state = format!("{model} --pressure {pressure:.4}{gap}{}", further.collect::<String>());
        output!("\nstart it, with readings by formula until the scene has a sensor:")?;
        output!("  softtwind twin --scene {scene}")?;
        output!("  softtwind bridge --scene {scene}")?;
        output!(
            "  softtwin view --scene {scene}      in a browser; or: softtwin demo --scene {scene} --seconds 10"
        )?;
        output!("ask it without starting it, and draw it:")?;
        output!("  softtwin predict {state}")?;
        output!("  softtwin draw {state} --out {}", quoted(&self.folder.join("state.png")))?;
        Ok(())
    }
}

/// Largest pressure (MPa) over the interval of the shear modulus: the elastomer's stresses and the pressure scale together; the weight
/// and the sheet, which does not stretch, are left out.
fn material_interval(actuator: &Actuator, pressures: &Pressures) -> Option<[f64; 2]> {
    let shear = actuator.elastomer.law.shear_modulus_mpa();
    actuator
        .elastomer
        .shear_interval_mpa
        .map(|interval| interval.map(|mpa| pressures.largest_mpa() * mpa / shear))
}
