//! An equilibrium path over the injected volume, through limits of the pressure: table, limits, picture.

use super::single::sorted;
use crate::failure::configuration;
use crate::output;
use crate::picture::{Axis, Figure, Mark, Panel, Series};
use anyhow::Context;
use fem::actuator::Setting;
use fem::{Bending, Family, Limit, Load, PathPoint, PathSettings, Problem, Solver, Stretches, limits};
use formats::file;
use formats::table::to_text;
use serde_json::{Value, json};
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

/// Options.
pub struct Target {
    /// Injected volume at the end (mm3).
    pub volume_mm3: f64,
    pub gap_mm: Option<f64>,
    pub points: usize,
    /// Quantities of the actuator with other values than its file's.
    pub settings: Vec<Setting>,
}

/// A point with its figures.
struct Row {
    volume_mm3: f64,
    pressure_mpa: f64,
    /// NaN without an end section.
    angle_deg: f64,
    displacement_mm: f64,
    stretches: Stretches,
    negative_eigenvalues: usize,
    /// At given pressure, at given volume.
    is_stable: [bool; 2],
}

/// Follows the path, prints table and limits, writes table and picture.
pub fn run(family: &Family, target: &Target, out: Option<&Path>, as_json: bool) -> anyhow::Result<()> {
    let variant = family.variant(&target.settings).map_err(configuration)?;
    let problem = family.problem_of(&variant).map_err(configuration)?;
    let actuator = family.actuator_of(&variant).map_err(configuration)?;
    let mut solver = Solver::new(Arc::clone(&problem))?;
    let (rest, _) = solver.gravity_equilibrium(actuator.loads.gravity_mm_s2)?;
    let begin = Load { injected_mm3: Some(0.0), ..actuator.load(0.0, target.gap_mm) };
    let (start, _) = solver.solve_to(&rest, &begin).map_err(sorted)?;
    let variant_family = Family { actuator, problem: Arc::clone(&problem) };
    let section = Bending::all(&variant_family).into_iter().next();
    let mut rows: Vec<Row> = Vec::new();
    let mut printed = Ok(());
    if !as_json {
        output!(
            "{:>12} {:>12} {:>9} {:>9} {:>8}  stable at given",
            "volume mm3",
            "pressure MPa",
            "angle deg",
            "moved mm",
            "stretch"
        )?;
    }
    let settings = PathSettings { end_mm3: target.volume_mm3, points: target.points };
    let path = solver.path(&start, settings, &mut |point| {
        let row = Row::of(&problem, section.as_ref(), point, rows.last());
        if !as_json && printed.is_ok() {
            printed = row.print();
        }
        rows.push(row);
    });
    printed?;
    let path = path.map_err(sorted)?;
    let found = limits(&path.points);
    if let Some(dir) = out {
        write(dir, &rows, &found).context("the path was not written")?;
    }
    let beyond = rows.iter().map(|row| row.stretches).find(|stretches| stretches.is_beyond());
    let warning = beyond.and_then(|stretches| problem.stretch_warning(stretches));
    if as_json {
        return output::json(&json!({
            "points": rows.iter().map(Row::json).collect::<Vec<_>>(),
            "limits": found.iter().map(limit_json).collect::<Vec<_>>(),
            "ended": path.ended.as_ref().map(ToString::to_string),
            "beyond_law": warning,
            "factorisations": path.report.factorisations,
            "seconds": path.report.seconds,
        }));
    }
    for limit in &found {
        output!("{}", limit_text(limit))?;
    }
    if found.is_empty() {
        output!("no limit of pressure or volume")?;
    }
    if let Some(warning) = warning {
        output!("from there: {warning}")?;
    }
    if let Some(reason) = &path.ended {
        output!("ended before {} mm3: {reason}", target.volume_mm3)?;
    }
    output!(
        "{} points, {} factorisations, {:.1} s",
        rows.len(),
        path.report.factorisations,
        path.report.seconds
    )?;
    Ok(())
}

impl Row {
    fn of(problem: &Problem, section: Option<&Bending>, point: &PathPoint, before: Option<&Self>) -> Self {
        let u = &point.state.displacement_mm;
        let near = before.map_or(0.0, |row| row.angle_deg);
        let angle_deg = section.map_or(f64::NAN, |section| section.angle_deg(problem, u, near));
        Self {
            volume_mm3: point.injected_mm3,
            pressure_mpa: point.pressure_mpa(),
            angle_deg,
            displacement_mm: point.state.largest_displacement_mm(),
            stretches: problem.stretches(&point.state),
            negative_eigenvalues: point.negative_eigenvalues,
            is_stable: [point.is_stable_at_pressure(), point.is_stable_at_volume()],
        }
    }

    fn print(&self) -> anyhow::Result<()> {
        let stable = match self.is_stable {
            [true, _] => "pressure, volume",
            [false, true] => "volume",
            [false, false] => "-",
        };
        output!(
            "{:>12.3} {:>12.6} {:>9.2} {:>9.3} {:>8.3}  {stable}",
            self.volume_mm3,
            self.pressure_mpa,
            self.angle_deg,
            self.displacement_mm,
            self.stretches.largest
        )?;
        Ok(())
    }

    fn values(&self) -> [Value; COLUMNS.len()] {
        let [pressure, volume] = self.is_stable;
        [
            json!(self.volume_mm3),
            json!(self.pressure_mpa),
            json!(self.angle_deg),
            json!(self.displacement_mm),
            json!(self.stretches.largest),
            json!(self.negative_eigenvalues),
            json!(pressure),
            json!(volume),
        ]
    }

    fn json(&self) -> Value {
        COLUMNS.iter().map(|name| (*name).to_owned()).zip(self.values()).collect()
    }
}

fn limit_json(limit: &Limit) -> Value {
    json!({
        "limit": limit.kind.name(),
        "pressure_mpa": limit.pressure_mpa,
        "volume_mm3": limit.injected_mm3,
        "next_stable_volume_mm3": limit.next_injected_mm3,
    })
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
fn write(dir: &Path, rows: &[Row], found: &[Limit]) -> anyhow::Result<()> {
    file::create_folder(dir)?;
    let cells = rows.iter().map(|row| row.values().map(|value| value.to_string()));
    file::replace(&dir.join("path.csv"), to_text(&COLUMNS, cells).as_bytes())?;
    figure(rows, found).save(&dir.join("path.png"))
}

/// Pressure and angle over the volume, angle over the pressure; unstable parts at given pressure apart.
fn figure(rows: &[Row], found: &[Limit]) -> Figure {
    let panel = |x: (&str, fn(&Row) -> f64), y: (&str, fn(&Row) -> f64), marks: Vec<(f64, f64)>| {
        let of = |wanted: fn(&Row) -> bool| -> Vec<(f64, f64)> {
            rows.iter().filter(|row| wanted(row)).map(|row| (x.1(row), y.1(row))).collect()
        };
        let series = |name: &str, colour, mark, points| Series { name: name.into(), colour, mark, points };
        let drawn = vec![
            series("path", 4, Mark::Line, of(|_| true)),
            series("stable at given pressure", 0, Mark::Dots, of(|row| row.is_stable[0])),
            series("stable at given volume only", 1, Mark::Dots, of(|row| row.is_stable == [false, true])),
            series("limits", 3, Mark::Dots, marks),
        ];
        let series = drawn.into_iter().filter(|series| !series.points.is_empty()).collect();
        Panel { title: String::new(), x: Axis::linear(x.0), y: Axis::linear(y.0), series, map: None }
    };
    let volume: (&str, fn(&Row) -> f64) = ("injected volume [mm3]", |row| row.volume_mm3);
    let pressure: (&str, fn(&Row) -> f64) = ("pressure [kPa]", |row| 1.0e3 * row.pressure_mpa);
    let angle: (&str, fn(&Row) -> f64) = ("angle of the end section [deg]", |row| row.angle_deg);
    let marks = found.iter().map(|limit| (limit.injected_mm3, 1.0e3 * limit.pressure_mpa)).collect();
    let mut panels = vec![panel(volume, pressure, marks)];
    if rows.iter().all(|row| row.angle_deg.is_finite()) {
        panels.extend([panel(volume, angle, Vec::new()), panel(pressure, angle, Vec::new())]);
    }
    let columns = panels.len();
    Figure { title: "equilibrium path".into(), panels, columns }
}
