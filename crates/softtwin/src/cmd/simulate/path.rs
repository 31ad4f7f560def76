//! An equilibrium path over the injected volume, through limits of the pressure: table, limits, picture.

use super::single::sorted;
use crate::failure::configuration;
use crate::picture::{Figure, Mark, Panel, Series};
use crate::report;
use anyhow::Context;
use fem::actuator::Setting;
use fem::{Bending, Family, Limit, Load, PathSettings, Solver, limits};
use formats::file;
use formats::table::to_text;
use serde::Serialize;
use serde_json::json;
use std::path::Path;
use std::sync::Arc;

/// Points of a path whose volume rises all the way.
pub const POINTS: u32 = 40;
/// Columns of the table.
const COLUMNS: [&str; 8] = [
    "volume_mm3",
    "pressure_mpa",
    "angle_deg",
    "max_displacement_mm",
    "largest_stretch",
    "negative_eigenvalues",
    "stable_at_pressure",
    "stable_at_volume",
];

/// What `simulate` is asked along a path of volumes.
pub struct PathEnd {
    /// Injected volume at the end (mm3).
    pub volume_mm3: f64,
    pub gap_mm: Option<f64>,
    pub points: usize,
    /// Quantities of the actuator with other values than its file's.
    pub settings: Vec<Setting>,
}

/// A point with its figures.
#[derive(Serialize)]
struct PathRow {
    volume_mm3: f64,
    pressure_mpa: f64,
    /// NaN without an end section.
    angle_deg: f64,
    max_displacement_mm: f64,
    largest_stretch: f64,
    negative_eigenvalues: usize,
    stable_at_pressure: bool,
    stable_at_volume: bool,
}

/// An equilibrium path.
#[derive(Serialize)]
struct PathReport {
    points: Vec<PathRow>,
    limits: Vec<LimitReport>,
    /// Why it ended before the wanted volume.
    ended: Option<String>,
    beyond_law: Option<String>,
    factorisations: usize,
    seconds: f64,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    remarks: Vec<String>,
}

#[derive(Serialize)]
struct LimitReport {
    limit: &'static str,
    pressure_mpa: f64,
    volume_mm3: f64,
    next_stable_volume_mm3: Option<f64>,
}

/// Follows the path, prints table and limits, writes table and picture.
pub fn run(family: &Family, target: &PathEnd, out: Option<&Path>, as_json: bool) -> anyhow::Result<()> {
    let variant = family.variant(&target.settings).map_err(configuration)?;
    let problem = family.problem_of(&variant).map_err(configuration)?;
    let actuator = family.actuator_of(&variant).map_err(configuration)?;
    let mut solver = Solver::new(Arc::clone(&problem))?;
    let (rest, _) = solver.gravity_equilibrium(actuator.loads.gravity_mm_s2)?;
    let begin = Load { injected_mm3: Some(0.0), ..actuator.load(0.0, target.gap_mm) };
    let (start, _) = solver.solve_to(&rest, &begin).map_err(sorted)?;
    let variant_family = Family { actuator, problem: Arc::clone(&problem) };
    let section = Bending::all(&variant_family).into_iter().next();
    let mut rows: Vec<PathRow> = Vec::new();
    let mut beyond_law = None;
    let settings = PathSettings { end_mm3: target.volume_mm3, points: target.points };
    let path = solver.path(&start, settings, &mut |point| {
        let u = &point.state.displacement_mm;
        let near = rows.last().map_or(0.0, |row| row.angle_deg);
        let stretches = problem.stretches(&point.state);
        if beyond_law.is_none() {
            beyond_law = problem.stretch_warning(stretches);
        }
        let row = PathRow {
            volume_mm3: point.injected_mm3,
            pressure_mpa: point.pressure_mpa(),
            angle_deg: section.as_ref().map_or(f64::NAN, |section| section.angle_deg(&problem, u, near)),
            max_displacement_mm: point.state.largest_displacement_mm(),
            largest_stretch: stretches.largest,
            negative_eigenvalues: point.negative_eigenvalues,
            stable_at_pressure: point.is_stable_at_pressure(),
            stable_at_volume: point.is_stable_at_volume(),
        };
        tracing::info!("{:.3} mm3, {:.6} MPa", row.volume_mm3, row.pressure_mpa);
        rows.push(row);
    });
    let path = path.map_err(sorted)?;
    let found = limits(&path.points);
    if let Some(dir) = out {
        write(dir, &rows, &found).context("the path was not written")?;
    }
    let limit = |limit: &Limit| LimitReport {
        limit: limit.kind.name(),
        pressure_mpa: limit.pressure_mpa,
        volume_mm3: limit.injected_mm3,
        next_stable_volume_mm3: limit.next_injected_mm3,
    };
    let report = PathReport {
        points: rows,
        limits: found.iter().map(limit).collect(),
        ended: path.ended.as_ref().map(ToString::to_string),
        beyond_law,
        factorisations: path.report.factorisations,
        seconds: path.report.seconds,
        remarks: if as_json { Vec::new() } else { found.iter().map(limit_text).collect() },
    };
    report::print(&report, as_json)
}

fn limit_text(limit: &Limit) -> String {
    use fem::LimitKind::{Bifurcation, PressureMaximum, PressureMinimum, Volume};
    let (kpa, volume) = (1.0e3 * limit.pressure_mpa, limit.injected_mm3);
    let (what, way) = match limit.kind {
        PressureMaximum => ("limit of pressure", "rising"),
        PressureMinimum => ("limit of pressure", "falling"),
        Volume => {
            return format!(
                "limit of volume at {volume:.3} mm3, {kpa:.3} kPa: at given volume the state jumps"
            );
        }
        Bifurcation => {
            return format!("bifurcation near {volume:.3} mm3, {kpa:.3} kPa: another branch leaves the path");
        }
    };
    let next = limit.next_injected_mm3.map_or_else(
        || "no stable state at that pressure on this path".to_owned(),
        |next| format!("the next stable state at that pressure is at {next:.3} mm3"),
    );
    format!("{what} at {kpa:.3} kPa, {volume:.3} mm3, at {way} pressure: {next}")
}

/// Writes `path.csv` and `path.png`.
fn write(dir: &Path, rows: &[PathRow], found: &[Limit]) -> anyhow::Result<()> {
    file::create_folder(dir)?;
    let cells = rows.iter().map(|row| {
        let numbers =
            [row.volume_mm3, row.pressure_mpa, row.angle_deg, row.max_displacement_mm, row.largest_stretch];
        let stable = [row.stable_at_pressure, row.stable_at_volume].map(|is_stable| is_stable.to_string());
        numbers
            .map(|value| json!(value).to_string())
            .into_iter()
            .chain([row.negative_eigenvalues.to_string()])
            .chain(stable)
    });
    file::replace(&dir.join("path.csv"), to_text(&COLUMNS, cells).as_bytes())?;
    figure(rows, found).save(&dir.join("path.png"))
}

/// Pressure and angle over the volume, angle over the pressure; unstable parts at given pressure apart.
fn figure(rows: &[PathRow], found: &[Limit]) -> Figure {
    let panel = |x: (&str, fn(&PathRow) -> f64), y: (&str, fn(&PathRow) -> f64), marks: Vec<(f64, f64)>| {
        let points = |wanted: fn(&PathRow) -> bool| -> Vec<(f64, f64)> {
            rows.iter().filter(|row| wanted(row)).map(|row| (x.1(row), y.1(row))).collect()
        };
        let drawn = vec![
            Series::new("path", 4, Mark::Line, points(|_| true)),
            Series::new("stable at given pressure", 0, Mark::Dots, points(|row| row.stable_at_pressure)),
            Series::new(
                "stable at given volume only",
                1,
                Mark::Dots,
                points(|row| !row.stable_at_pressure && row.stable_at_volume),
            ),
            Series::new("limits", 3, Mark::Dots, marks),
        ];
        let series = drawn.into_iter().filter(|series| !series.points.is_empty()).collect();
        Panel::new("", x.0, y.0, series)
    };
    let volume: (&str, fn(&PathRow) -> f64) = ("injected volume [mm3]", |row| row.volume_mm3);
    let pressure: (&str, fn(&PathRow) -> f64) = ("pressure [kPa]", |row| 1.0e3 * row.pressure_mpa);
    let angle: (&str, fn(&PathRow) -> f64) = ("angle of the end section [deg]", |row| row.angle_deg);
    let marks = found.iter().map(|limit| (limit.injected_mm3, 1.0e3 * limit.pressure_mpa)).collect();
    let mut panels = vec![panel(volume, pressure, marks)];
    if rows.iter().all(|row| row.angle_deg.is_finite()) {
        panels.extend([panel(volume, angle, Vec::new()), panel(pressure, angle, Vec::new())]);
    }
    let columns = panels.len();
    Figure { title: "equilibrium path".into(), panels, columns }
}
