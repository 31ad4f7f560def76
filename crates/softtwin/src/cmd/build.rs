//! `softtwin build`: from the geometry, or from an imported database, to a twin that can be started, in one command.

use super::evaluate;
use super::simulate::batch::CaseBar;
use crate::failure::usage;
use crate::files::{not_built, quoted};
use crate::progress::Doing;
use crate::{output, range, report, resources};
use anyhow::Result;
use fem::build::{BuildNotice, BuildReport, BuildSettings, Built, ImportedReport};
use serde::Serialize;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

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

impl Args {
    /// Builds and says how good the twin is and how it is started.
    ///
    /// # Errors
    /// The actuator cannot be built or solved, with what to change; I/O errors.
    pub fn run(self) -> Result<()> {
        let shown = BuildProgress { json: self.json, doing: Doing::default(), bar: Mutex::new(None) };
        let _heartbeat = shown.doing.heartbeat();
        let notify = |notice: BuildNotice<'_>| shown.take(notice);
        if self.folder.join("actuator.toml").is_file() {
            let settings = BuildSettings { quick: self.quick, size_mm: self.size_mm, threads: self.threads };
            let built = fem::build::build(&self.folder, &settings, &|| resources::cpu_s("self"), &notify);
            let mut built = built.map_err(not_built)?;
            shown.doing.end();
            self.draw(&mut built)?;
            let remarks = |built: &Built<BuildReport>| self.remarks(&built.report);
            return self.print(built, &self.more_states(), remarks);
        }
        if self.folder.join("database/database.toml").is_file() {
            let mut built = fem::build::build_imported(&self.folder, &notify).map_err(not_built)?;
            shown.doing.end();
            self.draw(&mut built)?;
            let more_states = "more simulations near these states: softtwin import results";
            return self.print(built, more_states, |built| vec![imported_remark(&built.report)]);
        }
        let (name, folder) = (self.folder.display(), quoted(&self.folder));
        let database = quoted(&self.folder.join("database"));
        Err(usage(format!(
            "{name}: expected a folder with actuator.toml, which `softtwin new {folder}` makes, or with an imported database: \
             `softtwin import results ... --out {database}`"
        )))
    }

    /// Draws the errors on the held-out states.
    fn draw<R>(&self, built: &mut Built<R>) -> Result<()> {
        if let Some(report) = &built.held_out {
            let picture = self.folder.join("errors.png");
            evaluate::picture(report).save(&picture)?;
            built.quality.picture = Some(picture);
        }
        Ok(())
    }

    /// For programs all figures; for people the errors as a table, what is wrong with them, and what to do next.
    fn print<R: Serialize>(
        &self,
        built: Built<R>,
        more_states: &str,
        next: impl FnOnce(&Built<R>) -> Vec<String>,
    ) -> Result<()> {
        if self.json {
            return report::print(&built, true);
        }
        let quality = &built.quality;
        let mut remarks = vec![match &quality.picture {
            Some(picture) => format!(
                "errors are at the worst node of a state, mean and worst, in % of its largest value (of a force: of all); by state: {}",
                picture.display()
            ),
            None => "no held-out state (split = test): the error is from leave-one-out only".into(),
        }];
        if !quality.warnings.is_empty() {
            remarks.push("not good enough yet:".into());
            remarks.extend(quality.warnings.iter().map(|warning| format!("  {warning}")));
            remarks.push(format!("  {more_states}"));
        }
        remarks.extend(next(&built));
        output!("")?;
        let quality = built.quality.rows();
        report::print(&Built { report: built.report, quality, held_out: None, remarks }, false)
    }

    fn more_states(&self) -> String {
        if self.quick {
            return format!("more states: softtwin build {}", quoted(&self.folder));
        }
        format!(
            "more states: softtwin sample --refine 8 --database {} --actuator {} --out finer",
            quoted(&self.folder.join("database")),
            quoted(&self.folder.join("actuator.toml"))
        )
    }

    /// How the twin is started, asked and drawn.
    fn remarks(&self, report: &BuildReport) -> Vec<String> {
        let (model, scene) = (quoted(&report.model), quoted(&report.scene));
        let pressure = 0.7 * report.contact_pressure_mpa;
        let gap = report.gap_mm.map_or(String::new(), |[a, b]| format!(" --gap {:.1}", 0.5 * (a + b)));
        let further = report.cavities.iter().map(|name| format!(" --set {name}={:.4}", 0.5 * pressure));
        let state = format!("{model} --pressure {pressure:.4}{gap}{}", further.collect::<String>());
        let picture = quoted(&self.folder.join("state.png"));
        let elements = "the finite elements themselves: mesh about 4 % (docs/fem.md), and whatever the silicone's constants are off";
        let commands = format!(
            "start it, with readings by formula until the scene has a sensor:\n  softtwind twin --scene {scene}\n  softtwind bridge --scene \
             {scene}\n  softtwin view --scene {scene}      in a browser; or: softtwin demo --scene {scene} --seconds 10\nask it without \
             starting it, and draw it:\n  softtwin predict {state}\n  softtwin draw {state} --out {picture}"
        );
        vec![elements.into(), commands]
    }
}

/// How a twin of imported states is started and asked.
fn imported_remark(report: &ImportedReport) -> String {
    let (model, scene) = (quoted(&report.model), quoted(&report.scene));
    let name = report.model.file_stem().unwrap_or_default().to_string_lossy();
    format!(
        "start it, with the readings of {} until the scene has a sensor:\n  softtwind twin --scene {scene}\n  softtwind bridge \
         --scene {scene} --loop\n  softtwin view --scene {scene}      in a browser; or: softtwin echo 'softtwin/{name}/state'\nask it \
         without starting it:\n  softtwin predict {model}{}",
        report.sweep.display(),
        report.middle
    )
}

/// Progress for people: a line for each result, a bar while states are solved, a line now and then while something takes long.
struct BuildProgress {
    json: bool,
    doing: Doing,
    bar: Mutex<Option<CaseBar>>,
}

impl BuildProgress {
    fn take(&self, notice: BuildNotice<'_>) {
        let mut bar = self.bar.lock().unwrap_or_else(PoisonError::into_inner);
        match notice {
            BuildNotice::Done { step, text } if !self.json => {
                // What a reader of the output misses when it is closed is a progress line.
                let _ = output::line(format_args!("{step:<10} {text}"));
            }
            BuildNotice::Done { .. } => {}
            BuildNotice::Begins(what) => self.doing.begin(what),
            BuildNotice::Solving(cases) => {
                self.doing.end();
                *bar = Some(CaseBar::new(cases));
            }
            BuildNotice::State(event) => {
                if let Some(bar) = &*bar {
                    bar.take(&event);
                }
            }
            BuildNotice::Solved => *bar = None,
        }
    }
}
