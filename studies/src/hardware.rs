//! `softtwin-studies hardware`: the finite elements against a measured bending block.
//!
//! Elastomer and pressure scale together without weight, so one calibrated constant `s` (stiffness over that of the tests) turns the
//! computed angle `a(p)` into `a(p / s)`; the interval of the fit is that of `s`. That of the mounting has one path per variation: the weight
//! in three directions, and the length between clamp and first chamber; the largest deviations of both kinds are added in squares.

use fem::actuator::{Actuator, Setting};
use fem::material::MaterialFile;
use fem::{PathSettings, Problem, Solver};
use softtwin::failure::usage;
use softtwin::files::refusal;
use softtwin::output;
use softtwin::picture::{Axis, Figure, Mark, Panel, Series};
use std::path::{Path, PathBuf};
use std::sync::Arc;

const EXAMPLES: &str = "\
Example, with the block's folder of published measurements (docs/hardware.md):
  softtwin material fit planar.toml --law yeoh --out yeoh.toml
  softtwin-studies hardware --data ../shared/realdata/epfl --material yeoh.toml --out hardware.png";

/// Pressure at which the measured angle is 0 (MPa), end of the first range, end of the measurement.
pub(crate) const ZERO_MPA: f64 = 0.010;
const BELOW_MPA: f64 = 0.034;
const ALL_MPA: f64 = 0.0451;
/// Half-width of the mean around a pressure of the table (MPa).
const WINDOW_MPA: f64 = 0.0001;
/// Pressures of the table (MPa).
const TABLE_MPA: [f64; 10] = [0.014, 0.018, 0.022, 0.026, 0.030, 0.032, 0.034, 0.036, 0.040, 0.045];
/// Weight along each of these directions (mm/s2), and change of the length between clamp and first chamber (mm): not stated.
const WEIGHTS_MM_S2: [[f64; 3]; 3] = [[0.0, -9810.0, 0.0], [0.0, 9810.0, 0.0], [9810.0, 0.0, 0.0]];
const CLAMP_MM: [f64; 2] = [-1.0, 1.0];
/// Injected volume (mm3) up to which the mounting is varied.
const MOUNTING_MM3: f64 = 16_000.0;
/// Range and steps of the calibrated constant.
const SCALES: [f64; 2] = [0.6, 1.6];
const SCALE_STEPS: usize = 2000;

/// Compare bending angle against pressure with a measured actuator.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Folder with `c5_w7_angle.csv`: pressure (MPa), angle (degrees).
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// Laws fitted to the batch's tests.
    #[arg(long, value_name = "FILE.toml", required = true)]
    material: Vec<PathBuf>,
    /// The block.
    #[arg(long, value_name = "FILE.toml", default_value = "models/shapes/epfl-block/actuator.toml")]
    actuator: PathBuf,
    /// Sister parts, predicted with the same constants; several.
    #[arg(long, value_name = "FILE.toml", num_args = 1..)]
    sister: Vec<PathBuf>,
    /// Longest edge of an element (mm).
    #[arg(long, value_name = "MM", default_value_t = 3.5, value_parser = softtwin::range::number(0.1, 100.0))]
    size_mm: f64,
    /// Injected volume at the end of the path (mm3), and its points.
    #[arg(long, value_name = "MM3", default_value_t = 20_000.0, value_parser = softtwin::range::number(1.0, 1e6))]
    volume_mm3: f64,
    /// Points of the path.
    #[arg(long, value_name = "N", default_value_t = 40, value_parser = softtwin::range::count(4, 1000))]
    points: usize,
    /// Half of the 95 % interval of the fit's initial modulus, relative.
    #[arg(long, value_name = "FRACTION", default_value_t = 0.07, value_parser = softtwin::range::number(0.0, 0.9))]
    interval: f64,
    /// Picture (.svg or .png).
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// Pressure (MPa) and angle (degrees), the angle rising.
pub(crate) type Curve = Vec<(f64, f64)>;

impl Args {
    /// Follows the block's path for each law and compares.
    ///
    /// # Errors
    /// Files that cannot be read; an actuator that cannot be solved.
    pub fn run(self) -> anyhow::Result<()> {
        let measured = measured(&self.data.join("c5_w7_angle.csv"))?;
        let range = measured.iter().map(|point| point.1).fold(0.0, f64::max);
        output!("measured: {} readings, {range:.1} degrees at the end", measured.len())?;
        let mut series = vec![series("measured", 0, Mark::Dots, &measured)];
        for (place, file) in self.material.iter().enumerate() {
            let material = MaterialFile::read(file).map_err(refusal)?;
            let block = actuator(&self.actuator, &material)?;
            let (curve, ended) = free_path(&block, self.size_mm, self.volume_mm3, self.points)?;
            let mounting = self.mounting(&block)?;
            let limit = curve.iter().map(|point| point.0).fold(0.0, f64::max);
            output!("\n{}: {}", file.display(), material.summary())?;
            output!("largest pressure {:.2} kPa; the path ends {ended}", 1e3 * limit)?;
            let scaled_angle = |mpa: f64, scale: f64| angle(&curve, mpa / scale);
            let best = calibrated(&scaled_angle, &measured, BELOW_MPA);
            output!(
                "{:>6} {:>9} {:>9} {:>19} {:>19} {:>9}",
                "kPa",
                "measured",
                "computed",
                "interval of fit",
                "of mounting",
                "calibrated"
            )?;
            for mpa in TABLE_MPA {
                let (Some(truth), cell) = (mean(&measured, mpa), |s: f64| cell(angle(&curve, mpa / s)))
                else {
                    continue;
                };
                let interval = [1.0 + self.interval, 1.0 - self.interval].map(cell);
                output!(
                    "{:>6.1} {truth:>9.2} {:>9} {:>19} {:>19} {:>9}",
                    1e3 * mpa,
                    cell(1.0),
                    interval.join(" to "),
                    mounted(&curve, &mounting, mpa),
                    cell(best)
                )?;
            }
            let whole = calibrated(&scaled_angle, &measured, ALL_MPA);
            for (label, scale) in [
                ("constants of the tests", 1.0),
                ("calibrated to 34 kPa", best),
                ("calibrated to 45 kPa", whole),
            ] {
                let errors = [BELOW_MPA, ALL_MPA].map(|to_mpa| {
                    let error = 100.0 * largest_error(&scaled_angle, &measured, scale, to_mpa) / range;
                    let kpa = 1e3 * to_mpa;
                    if error.is_finite() {
                        format!("largest error to {kpa:.0} kPa {error:.1} % of the range")
                    } else {
                        format!("the path ends before {kpa:.0} kPa")
                    }
                });
                output!("{label} (stiffness x {scale:.3}): {}", errors.join(", "))?;
            }
            let name = file.file_stem().map_or(String::new(), |name| name.to_string_lossy().into_owned());
            series.push(self::series(&name, 2 * place + 1, Mark::Line, &curve));
            let scaled: Curve = curve.iter().map(|(mpa, angle)| (best * mpa, *angle)).collect();
            series.push(self::series(&format!("{name}, calibrated"), 2 * place + 2, Mark::Line, &scaled));
            for sister in &self.sister {
                let (curve, ended) =
                    free_path(&actuator(sister, &material)?, self.size_mm, self.volume_mm3, self.points)?;
                output!("{}: the path ends {ended}", sister.display())?;
                output!("{:>6} {:>9} {:>19} {:>9}", "kPa", "computed", "interval", "calibrated")?;
                for mpa in TABLE_MPA {
                    let cell = |s: f64| cell(angle(&curve, mpa / s));
                    let interval = [1.0 + self.interval, 1.0 - self.interval].map(cell).join(" to ");
                    output!("{:>6.1} {:>9} {interval:>19} {:>9}", 1e3 * mpa, cell(1.0), cell(best))?;
                }
            }
        }
        if let Some(out) = &self.out {
            let panel = Panel {
                title: String::new(),
                x: Axis::linear("pressure [kPa]"),
                y: Axis::linear("bending angle [degrees]"),
                series,
                map: None,
            };
            Figure::one("Bending block against its hardware", panel).save(out)?;
        }
        Ok(())
    }

    /// Paths of other weights, and of other lengths at the clamp.
    fn mounting(&self, block: &Actuator) -> anyhow::Result<[Vec<Curve>; 2]> {
        let path = |settings: &[Setting]| -> anyhow::Result<Curve> {
            let varied = block.with(settings).map_err(|list| usage(format!("{list:?}")))?;
            Ok(free_path(&varied, self.size_mm, self.volume_mm3.min(MOUNTING_MM3), self.points)?.0)
        };
        let weight = |g: [f64; 3]| [0, 1, 2].map(|k| (format!("loads.gravity_mm_s2.{k}"), g[k]));
        let clamp = |change_mm: f64| -> anyhow::Result<Vec<Setting>> {
            let names = ["chambers.first_mm", "body.length_mm", "base.length_mm"];
            let value = |name: &str| block.quantity(name).map_err(|error| usage(error.to_string()));
            names.into_iter().map(|name| Ok((name.to_owned(), value(name)? + change_mm))).collect()
        };
        Ok([
            WEIGHTS_MM_S2.into_iter().map(|g| path(&weight(g))).collect::<anyhow::Result<_>>()?,
            CLAMP_MM.into_iter().map(|change_mm| path(&clamp(change_mm)?)).collect::<anyhow::Result<_>>()?,
        ])
    }
}

/// Angle along the path of rising volume, 0 at [`ZERO_MPA`], and where it ends.
pub(crate) fn free_path(
    actuator: &Actuator,
    size_mm: f64,
    end_mm3: f64,
    points: usize,
) -> anyhow::Result<(Curve, String)> {
    let problem = problem(actuator, size_mm)?;
    let shape = actuator.shape().ok_or_else(|| usage("--actuator: expected an actuator of boxes"))?;
    let node_at = |x: f64| nearest(&problem.mesh().nodes_mm, [x, 0.0, 0.0]);
    let (start, tip) = (node_at(0.0), node_at(shape.base.length_mm));
    let mut solver = Solver::new(Arc::clone(&problem))?;
    let (rest, _) = solver.gravity_equilibrium(actuator.loads.gravity_mm_s2)?;
    let mut curve: Curve = Vec::new();
    let path = solver.path(&rest, PathSettings { end_mm3, points }, &mut |point| {
        let position = |n: usize| -> [f64; 3] {
            [0, 1, 2].map(|k| problem.mesh().nodes_mm[n][k] + point.state.displacement_mm[n][k])
        };
        let (a, b) = (position(start), position(tip));
        curve.push((point.pressure_mpa(), (a[1] - b[1]).atan2(b[0] - a[0]).to_degrees()));
    })?;
    let zero = angle(&curve, ZERO_MPA).unwrap_or(0.0);
    curve.iter_mut().for_each(|point| point.1 -= zero);
    let last = curve.last().copied().unwrap_or_default();
    let why = path.ended.map_or_else(|| "at the wanted volume".into(), |reason| reason.to_string());
    Ok((curve, format!("at {:.2} kPa, {:.1} degrees: {why}", 1e3 * last.0, last.1)))
}

pub(crate) fn problem(actuator: &Actuator, size_mm: f64) -> anyhow::Result<Arc<Problem>> {
    let mesh = actuator.grid_mesh(size_mm, 1).map_err(|list| usage(format!("{list:?}")))?;
    Ok(Arc::new(Problem::new(mesh, actuator.problem_config())?))
}

/// The actuator with the material's law and its bulk modulus unchanged.
pub(crate) fn actuator(file: &Path, material: &MaterialFile) -> anyhow::Result<Actuator> {
    let mut actuator = Actuator::read(file).map_err(refusal)?;
    let bulk_mpa = actuator.elastomer.bulk_mpa;
    actuator.elastomer = fem::material::Elastomer { bulk_mpa, ..material.elastomer };
    Ok(actuator)
}

/// Interval of the angle at a pressure from the mounting.
fn mounted(curve: &Curve, kinds: &[Vec<Curve>; 2], mpa: f64) -> String {
    let Some(middle) = angle(curve, mpa) else { return cell(None) };
    let deviation = |paths: &Vec<Curve>| {
        let angles =
            paths.iter().map(|path| angle(path, mpa).map_or(f64::NAN, |angle| (angle - middle).abs()));
        angles.fold(0.0, |largest: f64, off| if off.is_nan() { off } else { largest.max(off) })
    };
    let half = kinds.iter().map(|paths| deviation(paths).powi(2)).sum::<f64>().sqrt();
    let end = |at: f64| cell(at.is_finite().then_some(at));
    format!("{} to {}", end(middle - half), end(middle + half))
}

fn series(name: &str, colour: usize, mark: Mark, curve: &Curve) -> Series {
    Series {
        name: name.into(),
        colour,
        mark,
        points: curve.iter().map(|(p, angle)| (1e3 * p, *angle)).collect(),
    }
}

fn nearest(nodes: &[[f64; 3]], place: [f64; 3]) -> usize {
    let distance = |n: &usize| (0..3).map(|k| (nodes[*n][k] - place[k]).powi(2)).sum::<f64>();
    (0..nodes.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(0)
}

/// Readings with their angle at [`ZERO_MPA`] taken off.
pub(crate) fn measured(path: &Path) -> anyhow::Result<Curve> {
    let text = formats::file::read_text(path, formats::file::MAX_TEXT_BYTES).map_err(refusal)?;
    let row = |line: &str| -> Option<(f64, f64)> {
        let (pressure, angle) = line.split_once(',')?;
        Some((pressure.trim().parse().ok()?, angle.trim().parse().ok()?))
    };
    let mut curve: Curve = text.lines().filter_map(row).collect();
    anyhow::ensure!(curve.len() > 1, "{}: expected rows of pressure, angle, found none", path.display());
    let first = curve[0].1;
    curve.iter_mut().for_each(|point| point.1 -= first);
    Ok(curve)
}

/// Mean of the readings around a pressure.
fn mean(curve: &Curve, mpa: f64) -> Option<f64> {
    let near: Vec<f64> =
        curve.iter().filter(|point| (point.0 - mpa).abs() <= WINDOW_MPA).map(|point| point.1).collect();
    (!near.is_empty()).then(|| near.iter().sum::<f64>() / near.len() as f64)
}

/// Angle at a rising pressure: on the first part of the path that has it, so behind a limit on the next one; `None` beyond all.
pub(crate) fn angle(curve: &Curve, mpa: f64) -> Option<f64> {
    let pair = curve.windows(2).find(|pair| (pair[0].0..=pair[1].0).contains(&mpa))?;
    let share = (mpa - pair[0].0) / (pair[1].0 - pair[0].0);
    Some(pair[0].1 + share * (pair[1].1 - pair[0].1))
}

fn cell(angle: Option<f64>) -> String {
    angle.map_or("beyond".into(), |angle| format!("{angle:.2}"))
}

/// Largest difference (degrees) up to a pressure between the measured angles and those of a modulus `scale` times that of the law, which
/// `scaled_angle` tells for a pressure and a scale; infinite where it tells none.
pub(crate) fn largest_error(
    scaled_angle: &impl Fn(f64, f64) -> Option<f64>,
    measured: &Curve,
    scale: f64,
    to_mpa: f64,
) -> f64 {
    let below = measured.iter().filter(|point| (ZERO_MPA..=to_mpa).contains(&point.0));
    below
        .map(|(mpa, truth)| scaled_angle(*mpa, scale).map_or(f64::INFINITY, |angle| (angle - truth).abs()))
        .fold(0.0, f64::max)
}

/// Stiffness over that of the tests with the smallest largest error up to a pressure.
pub(crate) fn calibrated(
    scaled_angle: &impl Fn(f64, f64) -> Option<f64>,
    measured: &Curve,
    to_mpa: f64,
) -> f64 {
    let at = |k: usize| SCALES[0] + (SCALES[1] - SCALES[0]) * k as f64 / SCALE_STEPS as f64;
    let error = |scale: &f64| largest_error(scaled_angle, measured, *scale, to_mpa);
    let best = (0..=SCALE_STEPS).map(at).min_by(|a, b| error(a).total_cmp(&error(b)));
    best.unwrap_or(1.0)
}
