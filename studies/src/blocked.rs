//! `softtwin-studies blocked`: why is the blocked force of the measured block computed too high? One row per hypothesis.
//!
//! Each hypothesis is a block, its clamp and what the tip touches. Its modulus is calibrated on the free bending angles to 34 kPa, because a
//! wrong modulus must not be mistaken for a wrong contact; the forces are then predictions. Without weight, pressure and elastomer scale
//! together: with a modulus `s` times that of the law, the force at `p` is `s` times that of the law at `p / s`, so no hypothesis needs
//! more than one path. The film does not scale, but it hardly stretches.

use crate::hardware::{ZERO_MPA, actuator, angle, calibrated, free_path, largest_error, measured, problem};
use fem::actuator::{Actuator, Setting};
use fem::material::MaterialFile;
use fem::{Solver, State};
use rom::statistics::mean;
use serde::Serialize;
use softtwin::failure::usage;
use softtwin::files::refusal;
use softtwin::report;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Example (docs/hardware.md), some 2 minutes of processor time per hypothesis:
  softtwin-studies blocked --data ../shared/realdata/epfl --material gent.toml";

/// Angles up to this pressure calibrate the modulus (MPa); beyond, the block balloons.
const CALIBRATED_TO_MPA: f64 = 0.034;
/// Pressures of the table (MPa).
const TABLE_MPA: [f64; 3] = [0.020, 0.030, 0.034];
/// Gaps between the tip at rest and the plate (mm); the rig's is not stated.
const GAPS_MM: [f64; 3] = [0.1, 1.0, 3.0];
/// Injected volume at the end of a free path (mm3), and its points.
const VOLUME_MM3: f64 = 9_000.0;
const POINTS: usize = 20;
/// Weight, tip down (mm/s2): what it presses on the plate without pressure tells the tip's stiffness.
const WEIGHT_MM_S2: f64 = -9810.0;
/// A load cell: a bar cell for 10 N bends by less than this (N/mm).
const LOAD_CELL_N_PER_MM: f64 = 5.0;
/// Times after a change of pressure from which a plateau is settled (s): each lasts 3 s, the rest between them to 6 s.
const SETTLED_S: [f64; 2] = [1.5, 4.5];

/// Compute the blocked force of a measured block under each hypothesis about its rig.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Folder with `c5_w7_angle.csv`: pressure (MPa), angle (degrees); `c5_w7_force.csv`: time (s), force (N), pressure (MPa).
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// Law fitted to the batch's tests.
    #[arg(long, value_name = "FILE.toml")]
    material: PathBuf,
    /// The block.
    #[arg(long, value_name = "FILE.toml", default_value = "models/shapes/epfl-block/actuator.toml")]
    actuator: PathBuf,
    /// Longest edge of an element (mm).
    #[arg(long, value_name = "MM", default_value_t = 3.5, value_parser = softtwin::range::number(0.1, 100.0))]
    size_mm: f64,
    /// Hypotheses of the table by their numbers; all by default.
    #[arg(long, value_name = "NUMBER", num_args = 1.., value_parser = softtwin::range::count(1, HYPOTHESES.len()))]
    only: Vec<usize>,
    /// One JSON object instead of text.
    #[arg(long)]
    json: bool,
}

/// The order in which plate and pressure come.
#[derive(Clone, Copy, PartialEq)]
enum Order {
    PlateFirst,
    PressureFirst,
    /// The plate rests on a load cell that yields.
    LoadCell,
}

struct Hypothesis {
    name: &'static str,
    settings: &'static [(&'static str, f64)],
    order: Order,
}

/// The plate under the last 3 mm only: the edge of the tip.
const TIP: (&str, f64) = ("obstacle.x_mm.0", 49.0);
/// Chambers that lie on the film, as in the authors' published model: 15 mm high. The mesh needs some floor.
const FLOOR_1_MM: [(&str, f64); 4] =
    [("base.upper_mm", 1.0), ("chambers.top_mm", 9.0), ("channels.top_mm", 3.0), ("body.top_mm", 16.0)];
const FLOOR_HALF_MM: [(&str, f64); 4] =
    [("base.upper_mm", 0.5), ("chambers.top_mm", 8.5), ("channels.top_mm", 2.5), ("body.top_mm", 15.5)];
/// 5 mm more of the block between clamp and first chamber: what the authors' cup holds, if it does not hold it.
const LOOSE: [(&str, f64); 3] =
    [("chambers.first_mm", 12.0), ("body.length_mm", 57.0), ("base.length_mm", 57.0)];

const HYPOTHESES: [Hypothesis; 12] = {
    const fn new(name: &'static str, settings: &'static [(&'static str, f64)], order: Order) -> Hypothesis {
        Hypothesis { name, settings, order }
    }
    use Order::{LoadCell, PlateFirst, PressureFirst};
    const THIN: [(&str, f64); 4] = FLOOR_1_MM;
    const THIN_TIP: [(&str, f64); 5] = [THIN[0], THIN[1], THIN[2], THIN[3], TIP];
    const HALF_TIP: [(&str, f64); 5] =
        [FLOOR_HALF_MM[0], FLOOR_HALF_MM[1], FLOOR_HALF_MM[2], FLOOR_HALF_MM[3], TIP];
    const LOOSE_TIP: [(&str, f64); 4] = [LOOSE[0], LOOSE[1], LOOSE[2], ("obstacle.x_mm.0", 54.0)];
    const THIN_LOOSE: [(&str, f64); 8] =
        [THIN[0], THIN[1], THIN[2], THIN[3], LOOSE[0], LOOSE[1], LOOSE[2], ("obstacle.x_mm.0", 54.0)];
    const LOOSE_SOFT_FILM: [(&str, f64); 9] = {
        let mut settings = [("sheet.youngs_mpa", 10.0); 9];
        let mut at = 0;
        while at < THIN_LOOSE.len() {
            settings[at] = THIN_LOOSE[at];
            at += 1;
        }
        settings
    };
    const SOFT_FILM: [(&str, f64); 6] = [THIN[0], THIN[1], THIN[2], THIN[3], TIP, ("sheet.youngs_mpa", 10.0)];
    [
        new("22 mm high, plate below all of it", &[], PlateFirst),
        new("22 mm, plate below the tip", &[TIP], PlateFirst),
        new("22 mm, tip, inflated before it is pressed", &[TIP], PressureFirst),
        new("22 mm, tip, load cell of 5 N/mm", &[TIP], LoadCell),
        new("22 mm, tip, film of 10 MPa", &[TIP, ("sheet.youngs_mpa", 10.0)], PlateFirst),
        new("22 mm, tip, 5 mm loose in the clamp", &LOOSE_TIP, PlateFirst),
        new("chambers on the film, plate below all of it", &THIN, PlateFirst),
        new("chambers on the film, tip", &THIN_TIP, PlateFirst),
        new("chambers on the film (floor 0.5 mm), tip", &HALF_TIP, PlateFirst),
        new("chambers on the film, tip, film of 10 MPa", &SOFT_FILM, PlateFirst),
        new("chambers on the film, tip, 5 mm loose", &THIN_LOOSE, PlateFirst),
        new("chambers on the film, tip, 5 mm loose, film of 10 MPa", &LOOSE_SOFT_FILM, PlateFirst),
    ]
};

/// What the study found.
#[derive(Serialize)]
struct BlockedReport {
    title: String,
    measured: Vec<Plateau>,
    hypotheses: Vec<HypothesisRow>,
    forces: Vec<ForceRow>,
}

/// Means over the settled part of the plateaus at one pressure.
#[derive(Serialize)]
struct Plateau {
    pressure_kpa: f64,
    force_n: f64,
    /// The load cell between the plateaus before and after.
    at_rest_n: f64,
    net_n: f64,
}

#[derive(Serialize)]
struct HypothesisRow {
    number: usize,
    hypothesis: &'static str,
    /// Of the block alone.
    mass_g: f64,
    /// Stiffness over that of the law that suits the free angles.
    modulus_factor: f64,
    largest_angle_error_deg: f64,
    /// The tip without pressure against a plate: what its sag pressed it on with, over the sag.
    tip_stiffness_n_per_mm: f64,
    /// What the tip presses on the plate with by its weight.
    weight_on_plate_n: f64,
}

#[derive(Serialize)]
struct ForceRow {
    number: usize,
    gap_mm: f64,
    at_20_kpa_n: Option<f64>,
    at_30_kpa_n: Option<f64>,
    at_34_kpa_n: Option<f64>,
    /// Computed over measured at 30 kPa.
    ratio_at_30_kpa: Option<f64>,
}

impl Args {
    /// Solves each hypothesis and prints the table.
    ///
    /// # Errors
    /// Files that cannot be read; a block that cannot be solved.
    pub fn run(self) -> anyhow::Result<()> {
        let angles = measured(&self.data.join("c5_w7_angle.csv"))?;
        let plateaus = plateaus(&self.data.join("c5_w7_force.csv"))?;
        let at_30_n =
            plateaus.iter().find(|plateau| plateau.pressure_kpa == 30.0).map(|plateau| plateau.net_n);
        let material = MaterialFile::read(&self.material).map_err(refusal)?;
        let block = actuator(&self.actuator, &material)?;
        let (mut hypotheses, mut forces) = (Vec::new(), Vec::new());
        for (place, hypothesis) in HYPOTHESES.iter().enumerate() {
            let number = place + 1;
            if !self.only.is_empty() && !self.only.contains(&number) {
                continue;
            }
            tracing::info!("{number} of {}: {}", HYPOTHESES.len(), hypothesis.name);
            let settings: Vec<Setting> =
                hypothesis.settings.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
            let varied = block.with(&settings).map_err(|list| usage(format!("{list:?}")))?;
            let (curve, _) = free_path(&varied, self.size_mm, VOLUME_MM3, POINTS)?;
            // Measured and computed angles are 0 at the same pressure, whatever the modulus.
            let scaled_angle =
                |mpa: f64, scale: f64| Some(angle(&curve, mpa / scale)? - angle(&curve, ZERO_MPA / scale)?);
            let factor = calibrated(&scaled_angle, &angles, CALIBRATED_TO_MPA);
            let mut rig = Rig::new(&varied, self.size_mm)?;
            let (weight_on_plate_n, stiffness) = resting(&varied, self.size_mm)?;
            hypotheses.push(HypothesisRow {
                number,
                hypothesis: hypothesis.name,
                mass_g: rig.mass_g(),
                modulus_factor: factor,
                largest_angle_error_deg: largest_error(&scaled_angle, &angles, factor, CALIBRATED_TO_MPA),
                tip_stiffness_n_per_mm: factor * stiffness,
                weight_on_plate_n,
            });
            for gap_mm in GAPS_MM {
                rig.rest();
                let mut scaled_n = [None; TABLE_MPA.len()];
                for (mpa, slot) in TABLE_MPA.iter().zip(&mut scaled_n) {
                    *slot = rig.force_n(mpa / factor, gap_mm, hypothesis.order)?.map(|n| factor * n);
                }
                let [at_20_kpa_n, at_30_kpa_n, at_34_kpa_n] = scaled_n;
                let ratio_at_30_kpa = at_30_kpa_n.zip(at_30_n).map(|(computed, truth)| computed / truth);
                forces.push(ForceRow {
                    number,
                    gap_mm,
                    at_20_kpa_n,
                    at_30_kpa_n,
                    at_34_kpa_n,
                    ratio_at_30_kpa,
                });
            }
        }
        let title = format!("blocked force of {}: {}", self.actuator.display(), material.summary());
        report::print(&BlockedReport { title, measured: plateaus, hypotheses, forces }, self.json)
    }
}

/// What the tip presses on a plate with by its weight (N), and that over the sag that the plate takes away (N/mm).
fn resting(block: &Actuator, size_mm: f64) -> anyhow::Result<(f64, f64)> {
    let weight: Setting = ("loads.gravity_mm_s2.1".into(), WEIGHT_MM_S2);
    let heavy = block.with(&[weight]).map_err(|list| usage(format!("{list:?}")))?;
    let mut solver = Solver::new(problem(&heavy, size_mm)?)?;
    let (sagging, _) = solver.gravity_equilibrium(heavy.loads.gravity_mm_s2)?;
    let sag_mm = solver.clearance_mm(&sagging);
    let (state, _) = solver.solve_to(&sagging, &heavy.load(0.0, Some(GAPS_MM[0])))?;
    let force_n = solver.output(&state).contact_force_n;
    Ok((force_n, force_n / (sag_mm - GAPS_MM[0])))
}

/// A block with its solver and the last state, from which the next one starts.
struct Rig {
    block: Actuator,
    solver: Solver,
    rest: State,
    last: State,
}

impl Rig {
    fn new(block: &Actuator, size_mm: f64) -> anyhow::Result<Self> {
        let mut solver = Solver::new(problem(block, size_mm)?)?;
        let (rest, _) = solver.gravity_equilibrium([0.0; 3])?;
        Ok(Self { block: block.clone(), solver, last: rest.clone(), rest })
    }

    fn rest(&mut self) {
        self.last = self.rest.clone();
    }

    fn mass_g(&self) -> f64 {
        let cavity_mm3 = self.solver.problem().undeformed_volume_mm3();
        let volume_mm3 = self.block.shape().map_or(f64::NAN, |shape| {
            shape.body.length_mm * shape.body.width_mm * shape.body.top_mm - cavity_mm3
        });
        1.0e6 * self.block.elastomer.density_t_per_mm3 * volume_mm3
    }

    /// Force on the plate; `None` where no equilibrium is found, because the free block balloons there.
    fn force_n(&mut self, mpa: f64, gap_mm: f64, order: Order) -> anyhow::Result<Option<f64>> {
        let mut gap_under_load_mm = gap_mm;
        let rounds = if order == Order::LoadCell { 4 } else { 1 };
        let mut force_n = 0.0;
        for _ in 0..rounds {
            if order == Order::PressureFirst {
                let Ok((free, _)) = self.solver.solve_to(&self.rest, &self.block.load(mpa, None)) else {
                    return Ok(None);
                };
                self.last = free;
            }
            let load = self.block.load(mpa, Some(gap_under_load_mm));
            let Ok((state, _)) = self.solver.solve_to(&self.last, &load) else { return Ok(None) };
            self.last = state;
            force_n = self.solver.output(&self.last).contact_force_n;
            gap_under_load_mm = gap_mm + force_n / LOAD_CELL_N_PER_MM;
        }
        Ok(Some(force_n))
    }
}

/// Forces by pressure, each minus the load cell's mean between the plateaus before and after: its zero drifts by 0.02 N over the test.
fn plateaus(path: &Path) -> anyhow::Result<Vec<Plateau>> {
    let text = formats::file::read_text(path, formats::file::MAX_TEXT_BYTES).map_err(refusal)?;
    let row = |line: &str| -> Option<[f64; 3]> {
        let mut cells = line.split(',').map(|cell| cell.trim().parse::<f64>().ok());
        Some([cells.next()??, cells.next()??, cells.next()??])
    };
    let rows: Vec<[f64; 3]> = text.lines().filter_map(row).collect();
    let settled_n = |[_, _, mpa]: [f64; 3], rows: &[[f64; 3]]| {
        let from_s = SETTLED_S[usize::from(mpa == 0.0)];
        mean(rows.iter().filter(|row| row[0] >= from_s).map(|row| row[1]))
    };
    let means: Vec<[f64; 2]> =
        rows.chunk_by(|a, b| a[2] == b[2]).map(|group| [group[0][2], settled_n(group[0], group)]).collect();
    let mut found: Vec<[f64; 3]> = Vec::new();
    for window in means.windows(3).filter(|window| window[1][0] > 0.0 && window[0][0] == 0.0) {
        found.push([1e3 * window[1][0], window[1][1], 0.5 * (window[0][1] + window[2][1])]);
    }
    found.sort_by(|a, b| a[0].total_cmp(&b[0]));
    anyhow::ensure!(
        !found.is_empty(),
        "{}: expected rows of time, force, pressure, plateaus between rows at pressure 0; found none",
        path.display()
    );
    let plateau = |group: &[[f64; 3]]| {
        let [force_n, at_rest_n] = [1, 2].map(|column| mean(group.iter().map(|row| row[column])));
        let pressure_kpa = (1e3 * group[0][0]).round() / 1e3;
        Plateau { pressure_kpa, force_n, at_rest_n, net_n: force_n - at_rest_n }
    };
    Ok(found.chunk_by(|a, b| a[0] == b[0]).map(plateau).collect())
}
