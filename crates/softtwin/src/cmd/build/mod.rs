//! `softtwin build`: from the geometry, or from an imported database, to a twin that can be started, in one command.

mod folder;
mod imported;
mod scene;
mod steps;

use super::simulate::batch;
use crate::failure::usage;
use crate::files::{self, not_planned, quoted, refusal, save};
use crate::progress::Doing;
use crate::{output, range, report, resources};
use anyhow::Result;
use fem::actuator::Actuator;
use fem::cases::to_csv;
use fem::observables;
use fem::plan::{Plan, solve_and_refine};
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
    /// A first look: fewer states, and more where the errors ask for them only while all takes less than 200 s of processor time. It
    /// prints the model's errors.
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
