//! `softtwin build`: from the geometry, or from an imported database, to a twin that can be started, in one command.

mod folder;
mod imported;
mod scene;

use super::mesh::write_grid;
use super::simulate::batch;
use crate::failure::{configuration, usage};
use crate::files::{self, not_planned, quoted, refusal, save};
use crate::progress::Doing;
use crate::{output, range, report, resources};
use anyhow::Result;
use fem::actuator::Actuator;
use fem::cases::{Case, to_csv};
use fem::plan::{Budget, Counts, Notice, Plan, Pressures, find, landings, solve_and_refine};
use fem::run::{Run, Store, fingerprint};
use fem::{Family, observables};
use folder::{Folder, OwnConfig, QualityReport, quality_report};
use rom::model::PressureLimit;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

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

/// A twin that was built.
#[derive(Serialize)]
struct BuildReport {
    model: PathBuf,
    scene: PathBuf,
    notes: Vec<String>,
    states: usize,
    failed: usize,
    reused: usize,
    pressure_mpa: f64,
    pressure_reason: String,
    /// Over the interval of a shear modulus that was not measured.
    pressure_interval_mpa: Option<[f64; 2]>,
    largest_stretch: f64,
    displacement_mm: f64,
    angle_deg: f64,
    contact_pressure_mpa: f64,
    gap_mm: Option<[f64; 2]>,
    quality: QualityReport,
    seconds: f64,
    cpu_seconds: Option<f64>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    remarks: Vec<String>,
}

impl Args {
    /// Builds and says how good the twin is and how it is started.
    ///
    /// # Errors
    /// The actuator cannot be built or solved, with what to change; I/O errors.
    pub fn run(self) -> Result<()> {
        let path = self.folder.join("actuator.toml");
        let database = self.folder.join("database");
        let folder = Folder { path: &self.folder, json: self.json };
        if path.is_file() {
            return self.build(&folder, &path, &database);
        }
        if database.join("database.toml").is_file() {
            return imported::build(&folder, &database);
        }
        let (name, folder, database) = (self.folder.display(), quoted(&self.folder), quoted(&database));
        Err(usage(format!(
            "{name}: expected a folder with actuator.toml, which `softtwin new {folder}` makes, or with an imported database: \
             `softtwin import results ... --out {database}`"
        )))
    }

    fn build(&self, folder: &Folder<'_>, path: &Path, database: &Path) -> Result<()> {
        let began = Instant::now();
        let actuator = Actuator::read(path).map_err(refusal)?;
        if let Some((file, material)) = Actuator::material(path).map_err(refusal)? {
            folder.say("material", &format!("{}: {}", file.display(), material.summary()))?;
        }
        folder.say("mesh", &self.mesh(&actuator)?)?;
        let doing = Doing::default();
        let _heartbeat = doing.heartbeat();
        doing.begin("analysing the mesh");
        let family = files::family(path)?;
        let pressures = self.pressures(folder, &family, &doing)?;
        let interval_mpa = pressures.interval_mpa(&family.actuator.elastomer);
        let options = batch::Options { threads: self.threads, sensitivities: false, settings: Vec::new() };
        let (mut plan, further) = self.plan(folder, &family, &pressures, (database, &options))?;
        let ranges =
            family.problem.config().elastomers.iter().filter_map(|elastomer| elastomer.stretch_range);
        let limit = PressureLimit {
            pressure_mpa: pressures.largest_mpa(),
            reason: pressures.reason.clone(),
            // Corners of the states found are stretched beyond the laws' range.
            stretch: ranges.map(|range| range[1]).fold(pressures.stretch.max(1.0), f64::max),
        };
        folder.save_config(database, &OwnConfig { observables: observables(&family), limit })?;
        let outcome = solve_and_refine(
            &family,
            &mut plan,
            (database, further),
            &mut |cases| batch::solve(&family, cases, database, &options),
            // Where the system does not tell, the number of states alone ends the search.
            &|| resources::cpu_s("self").unwrap_or(0.0),
            // What a reader of the output misses when it is closed is a progress line.
            &mut |text| drop(folder.say("states", &text)),
        )
        .map_err(not_planned)?;
        save(&self.folder.join("cases.csv"), to_csv(&plan.cases).as_bytes())?;
        for (index, reason) in &outcome.failed {
            folder.say("left out", &format!("{}: {reason}", plan.cases[*index].name))?;
        }
        doing.begin("training");
        let (model, notes, data) = folder.train(database, family.actuator.obstacle_kind(), &doing)?;
        doing.begin("measuring the model");
        let more_states = match self.quick {
            true => format!("more states: softtwin build {}", quoted(&self.folder)),
            false => format!(
                "more states: softtwin sample --refine 8 --database {} --actuator {} --out finer",
                quoted(database),
                quoted(path)
            ),
        };
        let quality = folder.quality(&model, &data)?;
        let (quality, mut remarks) = quality_report(quality, &more_states, self.json);
        let scene = self.folder.join("scene.toml");
        folder.replace("scene", &scene, &scene::text(&family, &plan, &pressures))?;
        if !self.json {
            let elements = "the finite elements themselves: mesh about 4 % (docs/fem.md), and whatever the silicone's constants are off";
            remarks.push(elements.into());
            remarks.push(self.commands(&model, &scene, &plan));
        }
        let report = BuildReport {
            model,
            scene,
            notes,
            states: plan.cases.len(),
            failed: outcome.failed.len(),
            reused: outcome.reused,
            pressure_mpa: pressures.largest_mpa(),
            pressure_reason: pressures.reason,
            pressure_interval_mpa: interval_mpa,
            largest_stretch: pressures.stretch,
            displacement_mm: pressures.displacement_mm,
            angle_deg: pressures.angle_deg,
            contact_pressure_mpa: plan.contact_mpa,
            gap_mm: plan.gaps_mm,
            quality,
            seconds: began.elapsed().as_secs_f64(),
            cpu_seconds: resources::cpu_s("self"),
            remarks,
        };
        if !self.json {
            output!("")?;
        }
        report::print(&report, self.json)
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

    fn pressures(&self, folder: &Folder<'_>, family: &Family, doing: &Doing) -> Result<Pressures> {
        let store = Store::new(&self.folder.join("database/states"), fingerprint(&family.problem))?;
        let run = Run { family, store, threads: 1, sensitivities: false, searches_behind_limits: false };
        let mut notice = |notice| match notice {
            Notice::Begins(what) => doing.begin(what),
            // What a reader of the output misses when it is closed is a progress line.
            Notice::Found(text) => drop(folder.say("pressures", &text)),
        };
        let found = find(&run, &mut notice).map_err(not_planned)?;
        doing.end();
        let (largest_mpa, stretch) = (found.largest_mpa(), found.stretch);
        folder.say(
            "pressures",
            &format!("0 to {largest_mpa} MPa, stretches to {stretch:.2}: {}", found.reason),
        )?;
        let elastomer = &family.actuator.elastomer;
        if let (Some([low, high]), Some([softest, stiffest])) =
            (found.interval_mpa(elastomer), elastomer.shear_interval_mpa)
        {
            folder.say(
                "material",
                &format!(
                    "no constants of this silicone were measured: {:.0} mm need anything from {low:.2e} to {high:.2e} MPa (shear modulus \
                     {softest} to {stiffest} MPa); a tension test narrows it most (softtwin material fit)",
                    found.displacement_mm
                ),
            )?;
        }
        Ok(found)
    }

    /// The states to solve, and how many may be added to them.
    fn plan(
        &self,
        folder: &Folder<'_>,
        family: &Family,
        pressures: &Pressures,
        (database, options): (&Path, &batch::Options),
    ) -> Result<(Plan, Budget)> {
        let counts = if self.quick { Counts::QUICK } else { Counts::FULL };
        let mut plan = Plan::new(&family.actuator, pressures, counts).map_err(not_planned)?;
        if let (false, Some(gaps_mm)) = (plan.cavities.is_empty(), plan.gaps_mm) {
            let free: Vec<Case> = plan.cases.iter().filter(|case| case.gap_mm.is_none()).cloned().collect();
            let solved = batch::solve(family, &free, database, options).map_err(not_planned)?.solved;
            let (free, clearances_mm): (Vec<Case>, Vec<f64>) =
                solved.iter().map(|(at, solved)| (free[*at].clone(), solved.clearance_mm)).unzip();
            plan.cases.extend(landings(&free, &clearances_mm, gaps_mm));
        }
        let list = self.folder.join("cases.csv");
        save(&list, to_csv(&plan.cases).as_bytes())?;
        // States over the pressures of several cavities are a sample of the whole range; nothing is added to them.
        let further =
            if plan.cavities.is_empty() { counts.further } else { Budget { states: 0, cpu_s: 0.0 } };
        let more = match further.states {
            0 => String::new(),
            states => format!(", and at most {states} more where the errors ask for them"),
        };
        let gaps =
            plan.gaps_mm.map_or("no obstacle".into(), |[low, high]| format!("gaps {low} to {high} mm"));
        folder.say("states", &format!("{}{more}, in {}, {gaps}", plan.cases.len(), list.display()))?;
        Ok((plan, further))
    }

    /// How the twin is started, asked and drawn.
    fn commands(&self, model: &Path, scene: &Path, plan: &Plan) -> String {
        let (model, scene, pressure) = (quoted(model), quoted(scene), 0.7 * plan.contact_mpa);
        let gap = plan.gaps_mm.map_or(String::new(), |[a, b]| format!(" --gap {:.1}", 0.5 * (a + b)));
        let further = plan.cavities.iter().map(|name| format!(" --set {name}={:.4}", 0.5 * pressure));
        let state = format!("{model} --pressure {pressure:.4}{gap}{}", further.collect::<String>());
        let picture = quoted(&self.folder.join("state.png"));
        format!(
            "start it, with readings by formula until the scene has a sensor:\n  softtwind twin --scene {scene}\n  softtwind bridge --scene \
             {scene}\n  softtwin view --scene {scene}      in a browser; or: softtwin demo --scene {scene} --seconds 10\nask it without \
             starting it, and draw it:\n  softtwin predict {state}\n  softtwin draw {state} --out {picture}"
        )
    }
}
