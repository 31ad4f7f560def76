//! From an actuator's file, or from imported states, to a twin that can be started: mesh, pressures, states, model, its errors, scene.
//!
//! Everything goes into one folder. Solved states are kept there, so that a build that was stopped continues where it was.

mod folder;
mod imported;
mod report;
mod scene;
mod steps;

pub use imported::{ImportedReport, build_imported};
pub use report::{BuildError, BuildNotice, BuildReport, BuildSettings, Built, Notify};

use crate::actuator::Actuator;
use crate::bending::observables;
use crate::cases::to_csv;
use crate::family::Family;
use crate::plan::{Plan, solve_and_refine};
use crate::problem::Problem;
use folder::{Folder, OwnConfig};
use formats::file;
use rom::model::PressureLimit;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// Builds the twin of a folder with `actuator.toml`. `cpu_s` is the processor time of the process so far, if the system tells: it limits
/// the states that are added where the errors ask for them.
///
/// # Errors
/// The actuator cannot be built or solved, with what to change; I/O errors.
pub fn build(
    path: &Path,
    settings: &BuildSettings,
    cpu_s: &dyn Fn() -> Option<f64>,
    notify: Notify<'_>,
) -> Result<Built<BuildReport>, BuildError> {
    let began = Instant::now();
    let (folder, database) = (Folder { path, notify }, path.join("database"));
    let file = path.join("actuator.toml");
    let actuator = Actuator::read(&file)?;
    if let Some((file, material)) = Actuator::material(&file)? {
        folder.say("material", &format!("{}: {}", file.display(), material.summary()));
    }
    folder.mesh(&actuator, settings.size_mm)?;
    folder.begin("analysing the mesh");
    let problem = Problem::new(actuator.read_mesh(&file)?, actuator.problem_config())?;
    let family = Family { actuator, problem: Arc::new(problem) };
    let pressures = folder.pressures(&family, &database)?;
    let (mut plan, further) = folder.plan(&family, &pressures, &database, settings)?;
    let ranges = family.problem.config().elastomers.iter().filter_map(|elastomer| elastomer.stretch_range);
    let limit = PressureLimit {
        pressure_mpa: pressures.largest_mpa(),
        reason: pressures.reason.clone(),
        // Corners of the states found are stretched beyond the laws' range.
        stretch: ranges.map(|range| range[1]).fold(pressures.stretch.max(1.0), f64::max),
    };
    folder.save_config(&database, &OwnConfig { observables: observables(&family), limit })?;
    let outcome = solve_and_refine(
        &family,
        &mut plan,
        (&database, further),
        &mut |cases| folder.solve(&family, cases, &database, settings.threads),
        // Where the system does not tell, the number of states alone ends the search.
        &|| cpu_s().unwrap_or(0.0),
        &mut |text| folder.say("states", &text),
    )?;
    file::replace(&path.join("cases.csv"), to_csv(&plan.cases).as_bytes())?;
    for (index, reason) in &outcome.failed {
        folder.say("left out", &format!("{}: {reason}", plan.cases[*index].name));
    }
    folder.begin("training");
    let trained = folder.train(&database, family.actuator.obstacle_kind())?;
    folder.begin("measuring the model");
    let (quality, held_out) = trained.quality()?;
    let scene = path.join("scene.toml");
    folder.replace("scene", &scene, &scene::text(&family, &plan, &pressures))?;
    let Plan { cases, cavities, gaps_mm, contact_mpa, .. } = plan;
    let report = BuildReport {
        model: trained.path,
        scene,
        notes: trained.sheet.remarks,
        states: cases.len(),
        failed: outcome.failed.len(),
        reused: outcome.reused,
        pressure_mpa: pressures.largest_mpa(),
        pressure_interval_mpa: pressures.interval_mpa(&family.actuator.elastomer),
        pressure_reason: pressures.reason,
        largest_stretch: pressures.stretch,
        displacement_mm: pressures.displacement_mm,
        angle_deg: pressures.angle_deg,
        contact_pressure_mpa: contact_mpa,
        gap_mm: gaps_mm,
        seconds: began.elapsed().as_secs_f64(),
        cpu_seconds: cpu_s(),
        cavities,
    };
    Ok(Built { report, quality, held_out, remarks: Vec::new() })
}
