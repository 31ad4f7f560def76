//! A test of a silicone, from a testing machine's table to stretches and nominal stresses: which rows are fitted, and what was left out.
//! Then the law of several tests, with what is suspicious about them.

use super::columns::{
    self, ChosenColumn, CurveOrigin, DeformationQuantity, LawName, LoadQuantity, LoadingBranch,
    TestDescription, TestKind,
};
use super::fit::{self, Family, Fitted, Test, stretch_range};
use super::{Deformation, Hyperelastic};
use crate::mesh::four_digits;
use formats::FormatError;
use formats::log::Log;
use formats::unit;
use rom::statistics::{mean, median};

/// A test that was read.
pub struct Specimen {
    /// Name of the file.
    pub name: String,
    /// What was done to it.
    pub kind: TestKind,
    /// All rows in their order: stretch, nominal stress (MPa).
    pub rows: Vec<[f64; 2]>,
    /// Rows that are fitted.
    pub test: Test,
    /// Energy lost in the first and in the last loop, as a fraction of that of loading.
    pub loops: Vec<f64>,
    /// Columns, assumptions, and rows left out.
    pub notes: Vec<String>,
    /// True if the load was assumed to be nominal.
    pub is_load_assumed: bool,
}

/// Size of the specimen in the parameters above the table: `Specimen Width (mm);6`.
struct Head {
    length_mm: Option<f64>,
    area_mm2: Option<f64>,
}

/// Units of a cross-section, mm2.
const AREAS: [(&str, f64); 6] =
    [("mm^2", 1.0), ("mm2", 1.0), ("mm\u{b2}", 1.0), ("cm^2", 100.0), ("cm2", 100.0), ("cm\u{b2}", 100.0)];

impl Head {
    fn of(log: &Log) -> Self {
        let named = |words: &[&str]| -> Vec<&(String, f64)> {
            let is_so = |name: &str| words.iter().any(|word| name.to_lowercase().contains(word));
            log.parameters.iter().filter(|(name, value)| is_so(name) && *value > 0.0).collect()
        };
        let length = |words: &[&str]| {
            named(words).into_iter().find_map(|(name, value)| {
                let (quantity, factor) = unit::unit(unit::in_heading(name)?)?;
                (quantity == unit::Dimension::Length).then_some(factor * value)
            })
        };
        let area = named(&["section", "area"]).into_iter().find_map(|(name, value)| {
            let unit = AREAS.iter().find(|(unit, _)| name.to_lowercase().contains(unit));
            unit.map(|(_, factor)| factor * value)
        });
        let product = || Some(length(&["width"])? * length(&["thickness"])?);
        let round = || length(&["diameter"]).map(|d| 0.25 * std::f64::consts::PI * d * d);
        Self { length_mm: length(&["length"]), area_mm2: area.or_else(product).or_else(round) }
    }
}

/// Smallest number of rows of a fit.
const FEWEST: usize = 8;
/// Fewest different stretches of a fit: each row at the same one is the same point of a law.
const FEWEST_STRETCHES: usize = 4;
/// Difference from which stretches are different.
const SAME_STRETCH: f64 = 1e-6;
/// Fraction of the range of the deformation by which loading and unloading differ at least.
const TURN: f64 = 0.05;
/// Fraction of the largest stress below which a specimen that is pulled on has failed.
const FAILED: f64 = 0.8;
/// Stretch from which a test does not begin at rest, and fraction of the largest stress below which it is not loaded.
const FAR_FROM_REST: f64 = 1.15;
const UNLOADED: f64 = 0.1;
/// Stretch of the rows from which the origin is found.
const FIRST_STRETCH: f64 = 1.3;
/// Fraction of the stress of the first rows above which a specimen is taut.
const TAUT: f64 = 0.1;
/// Load of a row over the mean of the next three from which it is no measurement of the specimen.
const OUTLIER: f64 = 1.5;
/// Stress at no strain that is reported, as a fraction of the largest.
const OFFSET: f64 = 0.01;

/// Says what is missing for a fit.
fn check(points: &[[f64; 2]], notes: &[String]) -> Result<(), String> {
    if points.len() < FEWEST {
        return Err(format!(
            "expected at least {FEWEST} rows of loading, found {} ({})",
            points.len(),
            notes.join("; ")
        ));
    }
    let mut stretches: Vec<f64> = points.iter().map(|point| point[0]).collect();
    stretches.sort_by(f64::total_cmp);
    stretches.dedup_by(|next, last| *next - *last < SAME_STRETCH);
    if stretches.len() < FEWEST_STRETCHES {
        return Err(format!(
            "expected rows at {FEWEST_STRETCHES} different stretches at least, found {}: {:?}; is it the column of the deformation?",
            stretches.len(),
            stretches
        ));
    }
    Ok(())
}

/// True for a test that shortens the specimen.
fn is_compressed(rows: &[[f64; 2]]) -> bool {
    rows.iter().map(|row| row[0].ln()).sum::<f64>() < 0.0
}

/// The rows of a table that have both values, as stretches and nominal stresses (MPa).
fn stretches_and_stresses(
    (log, deformation, load): (&Log, &ChosenColumn<DeformationQuantity>, &ChosenColumn<LoadQuantity>),
    description: &TestDescription,
    kind: TestKind,
    notes: &mut Vec<String>,
) -> Result<Vec<[f64; 2]>, String> {
    let (head, quantity) = (Head::of(log), deformation.quantity);
    let mut size = |stated: Option<f64>, in_head: Option<f64>, note: &str, missing: &str| {
        if let (None, Some(value)) = (stated, in_head) {
            notes.push(note.replace("{}", &four_digits(value)));
        }
        stated.or(in_head).ok_or_else(|| missing.to_owned())
    };
    let length_mm = match quantity {
        DeformationQuantity::Displacement | DeformationQuantity::Length => size(
            description.length_mm,
            head.length_mm,
            "length {} mm from the head of the file; --length-mm states it",
            "a displacement or length needs the specimen's --length-mm",
        )?,
        _ => 1.0,
    };
    let area_mm2 = match load.quantity {
        LoadQuantity::Force => size(
            description.area_mm2,
            head.area_mm2,
            "cross-section {} mm2 from the head of the file; --area-mm2 states it",
            "a force needs the specimen's --area-mm2",
        )?,
        _ => 1.0,
    };
    let values = log.columns[deformation.index].iter().zip(&log.columns[load.index]);
    let finite: Vec<[f64; 2]> = values
        .map(|(d, l)| [d * deformation.factor, l * load.factor / area_mm2])
        .filter(|row| row.iter().all(|v| v.is_finite()))
        .collect();
    let is_missing =
        |at: &usize| !(log.columns[deformation.index][*at] + log.columns[load.index][*at]).is_finite();
    if let Some(first) = (0..log.rows()).find(is_missing) {
        notes.push(format!(
            "{} of {} rows without a value left out, the first in line {}",
            log.rows() - finite.len(),
            log.rows(),
            log.lines[first]
        ));
    }
    let is_strain = !matches!(quantity, DeformationQuantity::Stretch | DeformationQuantity::Length);
    let sum: f64 = finite.iter().map(|row| row[0]).sum();
    let sign = if kind == TestKind::Compression && is_strain && sum > 0.0 { -1.0 } else { 1.0 };
    let stretch = |value: f64| match quantity {
        DeformationQuantity::Strain => 1.0 + value,
        DeformationQuantity::TrueStrain => value.exp(),
        DeformationQuantity::Stretch => value,
        DeformationQuantity::Displacement => 1.0 + value / length_mm,
        DeformationQuantity::Length => value / length_mm,
    };
    let mut rows: Vec<[f64; 2]> = finite.iter().map(|row| [stretch(sign * row[0]), row[1]]).collect();
    if rows.iter().any(|row| row[0].is_nan() || row[0] <= 0.0) {
        return Err(
            "expected stretches above 0, found a strain of -1 or less; check quantity and unit of the deformation".into(),
        );
    }
    if is_compressed(&rows) && rows.iter().map(|row| row[1]).sum::<f64>() > 0.0 {
        rows.iter_mut().for_each(|row| row[1] = -row[1]);
        notes.push("compression with positive loads: their sign is changed".into());
    }
    if description.origin == CurveOrigin::Table
        && let Some(begin) = begins_stretched(&rows)
    {
        return Err(format!(
            "expected a test that begins near no strain, found a stretch of {begin:.2} with hardly any load; an elongation that counts from \
             100 % is --deformation stretch, a distance of grips needs its first value as --length-mm, and --origin slack removes slack"
        ));
    }
    if load.quantity == LoadQuantity::TrueStress {
        rows.iter_mut().for_each(|row| row[1] /= row[0]);
    }
    Ok(rows)
}

impl Specimen {
    /// Reads a test; strains above `max_strain` are left out, and working strains count by `working_weight` ([`Test::working_weight`]).
    ///
    /// # Errors
    /// I/O errors; a table whose columns are not known; too few rows.
    pub fn read(
        description: &TestDescription,
        max_strain: f64,
        working_weight: f64,
    ) -> Result<Self, FormatError> {
        let log = Log::read(&description.file, &description.table)?;
        Self::of_log(&log, description, max_strain, working_weight)
    }

    /// [`Specimen::read`] of a table in memory; the description's file is its name.
    ///
    /// # Errors
    /// A table whose columns are not known; too few rows.
    pub fn of_log(
        log: &Log,
        description: &TestDescription,
        max_strain: f64,
        working_weight: f64,
    ) -> Result<Self, FormatError> {
        let path = &description.file;
        let error = |text: String| FormatError::refused(path, text);
        let deformation = columns::deformation(log, &description.deformation).map_err(error)?;
        let load = columns::load(log, &description.load).map_err(error)?;
        let mut notes = vec![deformation.note.clone(), load.note.clone()];
        if !log.damaged.is_empty() {
            notes.push(format!(
                "{} damaged lines left out, the first: {}",
                log.damaged.len(),
                log.damaged[0]
            ));
        }
        let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        let (kind, why) = match description.test {
            Some(kind) => (kind, ""),
            None => guessed(&name, log).map_err(error)?,
        };
        if !why.is_empty() {
            notes.push(format!("a {} test, {why}; --test states it", kind.word()));
        }
        let rows = stretches_and_stresses((log, &deformation, &load), description, kind, &mut notes)
            .map_err(error)?;
        let compressed = is_compressed(&rows);
        let (branch, loops) = branch(&rows, description.branch, &mut notes);
        let origin = OriginFit::of(kind.deformation(), &branch);
        let zeroed = |rows: Vec<[f64; 2]>| {
            rows.into_iter().map(|row| origin.applied(row, description.origin)).collect()
        };
        let (branch, rows): (Vec<[f64; 2]>, Vec<[f64; 2]>) = (zeroed(branch), zeroed(rows));
        notes.extend(origin.note(description.origin));
        let points = usable(branch, compressed, max_strain, &mut notes);
        check(&points, &notes).map_err(error)?;
        let (weight, shape_only) = (description.weight, description.shape_only);
        let test = Test { deformation: kind.deformation(), points, weight, shape_only, working_weight };
        let is_load_assumed = load.note.contains("assumed");
        Ok(Self { name, kind, rows, test, loops, notes, is_load_assumed })
    }

    /// Divides the stresses of a test of the shape only by its modulus over that of the law.
    pub fn divide(&mut self, modulus: f64) {
        if self.test.shape_only {
            self.rows.iter_mut().for_each(|row| row[1] /= modulus);
            self.test = self.test.divided(modulus);
            self.notes.push(format!(
                "tells the shape only: {modulus:.3} times the law's modulus, by which its stress is divided"
            ));
        }
    }
}

/// Kind by the file's name and headings.
///
/// # Errors
/// A kind that no law is fitted to.
fn guessed(name: &str, log: &Log) -> Result<(TestKind, &'static str), String> {
    let text = format!("{name} {}", log.headings.join(" ")).to_lowercase();
    let has = |words: &[&str]| words.iter().any(|word| text.contains(word));
    let kind = match () {
        () if has(&["planar", "pure shear", "pure_shear", "pureshear"]) => TestKind::Planar,
        () if has(&["shear", "torsion"]) => {
            return Err("expected uniaxial, planar (pure shear), biaxial or compression, found a test of simple shear or torsion by its \
                        name; if it is one of these kinds, say --test"
                .into());
        }
        () if has(&["biax", "bi-ax", "bubble", "bulge", "balloon"]) => TestKind::Biaxial,
        () if has(&["compress"]) => TestKind::Compression,
        () if has(&["uniax", "tens", "strip", "d412", "iso37"]) => TestKind::Uniaxial,
        () => return Ok((TestKind::Uniaxial, "assumed")),
    };
    Ok((kind, "by its name"))
}

/// The least stretch of a test in which the specimen is stretched from the beginning, but not loaded: its origin is another one.
fn begins_stretched(rows: &[[f64; 2]]) -> Option<f64> {
    let reach = |row: &[f64; 2]| row[0].ln().abs();
    let [stretch, stress] = rows.iter().min_by(|a, b| reach(a).total_cmp(&reach(b)))?;
    let most = rows.iter().map(|row| row[1].abs()).fold(0.0, f64::max);
    (stretch.ln().abs() > FAR_FROM_REST.ln() && stress.abs() < UNLOADED * most).then_some(*stretch)
}

/// Rows of the wanted branch, and the fraction of energy lost in the first and last loop.
fn branch(rows: &[[f64; 2]], wanted: LoadingBranch, notes: &mut Vec<String>) -> (Vec<[f64; 2]>, Vec<f64>) {
    let reach: Vec<f64> = rows.iter().map(|row| row[0].ln().abs()).collect();
    let turns = turns(&reach);
    let branches: Vec<(usize, usize)> = turns.windows(2).map(|pair| (pair[0], pair[1])).collect();
    let loading: Vec<usize> =
        (0..branches.len()).filter(|k| reach[branches[*k].1] > reach[branches[*k].0]).collect();
    let energy = |(from, to): (usize, usize)| -> f64 {
        rows[from..=to].windows(2).map(|p| 0.5 * (p[0][1] + p[1][1]) * (p[1][0] - p[0][0])).sum::<f64>().abs()
    };
    let lost =
        |k: usize| (k + 1 < branches.len()).then(|| 1.0 - energy(branches[k + 1]) / energy(branches[k]));
    let mut loops: Vec<f64> =
        loading.iter().filter_map(|k| lost(*k)).filter(|lost| lost.is_finite()).collect();
    if loops.len() > 2 {
        notes.push(format!("{} loops of loading and unloading", loops.len()));
        loops = vec![loops[0], loops[loops.len() - 1]];
    }
    if let Some(first) = loops.first() {
        notes.push(format!(
            "unloading returns {:.0} % less energy than the first loading took{}",
            100.0 * first.max(0.0),
            loops.get(1).map_or_else(String::new, |last| format!(
                ", {:.0} % less in the last loop",
                100.0 * last.max(0.0)
            ))
        ));
    }
    let chosen = match (loading.is_empty(), wanted) {
        (true, _) => {
            notes.push("the deformation only decreases: the rows are taken as one curve".into());
            rows.iter().rev().copied().collect()
        }
        (false, LoadingBranch::First) => {
            let mut farthest = -1.0;
            let mut further = |index: &usize| {
                let is_further = reach[*index] > farthest;
                farthest = reach[*index].max(farthest);
                is_further
            };
            // From the first loading on: what comes before (clamping, a descent to the origin) is no virgin curve.
            let first = branches[loading[0]].0;
            (first..rows.len()).filter(|at| further(at)).map(|at| rows[at]).collect()
        }
        (false, LoadingBranch::Last) => {
            let (from, to) = branches[loading[loading.len() - 1]];
            rows[from..=to].to_vec()
        }
    };
    if chosen.len() < rows.len() && !loading.is_empty() {
        let what = if wanted == LoadingBranch::First { "first loading" } else { "last loading" };
        notes.push(format!("{what}: {} of {} rows", chosen.len(), rows.len()));
    }
    (chosen, loops)
}

/// Indices at which the reach turns by more than a fraction of its range, with the first and the last row.
fn turns(reach: &[f64]) -> Vec<usize> {
    let (low, high) = reach.iter().fold((f64::INFINITY, 0.0_f64), |(a, b), v| (a.min(*v), b.max(*v)));
    let turn = TURN * (high - low);
    let mut turns = vec![0];
    let (mut least, mut most, mut rising) = (0, 0, None);
    for (index, value) in reach.iter().enumerate() {
        if *value <= reach[least] {
            least = index;
        }
        if *value >= reach[most] {
            most = index;
        }
        if rising != Some(true) && *value > reach[least] + turn {
            if rising == Some(false) || least > 0 {
                turns.push(least);
            }
            (rising, most) = (Some(true), index);
        } else if rising != Some(false) && *value < reach[most] - turn {
            if rising == Some(true) || most > 0 {
                turns.push(most);
            }
            (rising, least) = (Some(false), index);
        }
    }
    let last = reach.len().saturating_sub(1);
    let end = match rising {
        Some(true) => most,
        Some(false) => least,
        None => last,
    };
    turns.push(end);
    turns.dedup();
    turns
}

/// Rows without those above the strain, after failure, or with a load against the deformation.
fn usable(
    mut rows: Vec<[f64; 2]>,
    compressed: bool,
    max_strain: f64,
    notes: &mut Vec<String>,
) -> Vec<[f64; 2]> {
    let peak = (0..rows.len()).max_by(|a, b| rows[*a][1].abs().total_cmp(&rows[*b][1].abs())).unwrap_or(0);
    if rows.last().is_some_and(|row| row[1].abs() < FAILED * rows[peak][1].abs())
        && rows[peak][0].ln().abs() > 0.0
    {
        let failed = rows.len() - peak - 1;
        notes.push(format!("failed at a stretch of {:.2}: {failed} rows after it left out", rows[peak][0]));
        rows.truncate(peak + 1);
    }
    let before = rows.len();
    rows.retain(|row| row[0] <= 1.0 + max_strain + 1.0e-9);
    if rows.len() < before {
        notes.push(format!(
            "{} rows above a strain of {max_strain} left out (--max-strain)",
            before - rows.len()
        ));
    }
    let sign = if compressed { -1.0 } else { 1.0 };
    let is_against = |row: &[f64; 2]| sign * (row[0] - 1.0) < 0.0 || sign * row[1] < 0.0;
    leave_out(&mut rows, is_against, "with a load against the deformation", notes);
    let outliers: Vec<[f64; 2]> =
        rows.windows(4).filter(|four| stands_out(four)).map(|four| four[0]).collect();
    leave_out(&mut rows, |row| outliers.contains(row), "with a load far above those that follow", notes);
    rows
}

/// Removes rows and names the first of them.
fn leave_out(
    rows: &mut Vec<[f64; 2]>,
    is_unusable: impl Fn(&[f64; 2]) -> bool,
    why: &str,
    notes: &mut Vec<String>,
) {
    let before = rows.len();
    if let Some([stretch, stress_mpa]) = rows.iter().copied().find(&is_unusable) {
        rows.retain(|row| !is_unusable(row));
        notes.push(format!(
            "{} rows {why} left out, the first at a stretch of {stretch:.3} with {stress_mpa:.2e} MPa",
            before - rows.len()
        ));
    }
}

/// True if the load of the first of four rows falls over all others: a shock at the start of the machine, as no elastomer softens by so
/// much at working strains.
fn stands_out(four: &[[f64; 2]]) -> bool {
    let [first, next @ ..] = four else { return false };
    let load = |row: &[f64; 2]| row[1].abs();
    (first[0] - 1.0).abs() <= fit::WORKING_STRAINS[1]
        && next.iter().all(|row| load(row) < load(first))
        && load(first) > OUTLIER * mean(next.iter().map(load))
}

/// Strain at which the stress of the first rows extrapolates to 0, and stress (MPa) to which it extrapolates at no strain, by a neo-Hookean
/// law.
struct OriginFit {
    slack: f64,
    stress_mpa: f64,
    largest_mpa: f64,
}

impl OriginFit {
    /// Both are 0 if fewer than five rows are near the origin.
    fn of(deformation: Deformation, rows: &[[f64; 2]]) -> Self {
        let largest_mpa = rows.iter().map(|row| row[1].abs()).fold(0.0, f64::max);
        let first: Vec<&[f64; 2]> = rows.iter().filter(|p| p[0].max(1.0 / p[0]) <= FIRST_STRETCH).collect();
        if first.len() < 5 {
            return Self { slack: 0.0, stress_mpa: 0.0, largest_mpa };
        }
        let law = Hyperelastic::NeoHookean { mu_mpa: 1.0 };
        let unit = |p: &[f64; 2], slack: f64| {
            law.nominal_stress_mpa(deformation, p[0] / (1.0 + slack)).unwrap_or(f64::NAN)
        };
        // A slack specimen carries nothing: the other rows show where it begins.
        let least = TAUT * first.iter().map(|p| p[1].abs()).fold(0.0, f64::max);
        let taut: Vec<&[f64; 2]> = first.iter().copied().filter(|p| p[1].abs() > least).collect();
        let error = |slack: f64| {
            let model: Vec<f64> = taut.iter().map(|p| unit(p, slack)).collect();
            let (cross, own) =
                model.iter().zip(&taut).fold((0.0, 0.0), |(a, b), (m, p)| (a + m * p[1], b + m * m));
            model.iter().zip(&taut).map(|(m, p)| (cross / own * m - p[1]).powi(2)).sum::<f64>()
        };
        let shifts = (-150..=150).map(|k| 0.001 * f64::from(k));
        let slack = shifts.min_by(|a, b| error(*a).total_cmp(&error(*b))).unwrap_or(0.0);
        let model: Vec<f64> = first.iter().map(|p| unit(p, 0.0)).collect();
        let (m, p) = (mean(model.iter().copied()), mean(first.iter().map(|p| p[1])));
        let slope = model.iter().zip(&first).map(|(v, q)| (v - m) * (q[1] - p)).sum::<f64>()
            / model.iter().map(|v| (v - m).powi(2)).sum::<f64>();
        Self { slack, stress_mpa: p - slope * m, largest_mpa }
    }

    fn applied(&self, [stretch, stress_mpa]: [f64; 2], origin: CurveOrigin) -> [f64; 2] {
        match origin {
            CurveOrigin::Table => [stretch, stress_mpa],
            CurveOrigin::Slack => [stretch / (1.0 + self.slack), stress_mpa],
            CurveOrigin::Load => [stretch, stress_mpa - self.stress_mpa],
        }
    }

    fn note(&self, origin: CurveOrigin) -> Option<String> {
        let off = self.stress_mpa.abs() / self.largest_mpa;
        let found = format!(
            "the stress begins at a strain of {:.1} %, or with {:.2e} MPa at no strain",
            100.0 * self.slack,
            self.stress_mpa
        );
        match origin {
            CurveOrigin::Table if off > OFFSET => {
                Some(format!("{found}: slack, or an offset of the load; --origin slack or load removes it"))
            }
            CurveOrigin::Table => None,
            CurveOrigin::Slack => Some(format!("{found}: the strain is shifted")),
            CurveOrigin::Load => Some(format!("{found}: the stress is shifted")),
        }
    }
}

/// Ratio of initial shear moduli of two tests of one material that is no scatter.
const MISMATCH: f64 = 2.5;
/// Stretch up to which initial shear moduli are compared.
const INITIAL_STRETCH: f64 = 1.5;
/// Initial shear moduli of elastomers, MPa: from gels to hard polyurethane.
const SHEAR_MPA: [f64; 2] = [5e-4, 12.0];

/// The law of some tests.
pub struct FittedSpecimens {
    /// The tests; the stresses of those of the shape only are divided by their modulus.
    pub specimens: Vec<Specimen>,
    /// All laws that were fitted.
    pub candidates: Vec<Fitted>,
    /// The chosen one.
    pub best: Fitted,
    /// Stretches of a bar that the tests reach.
    pub range: [f64; 2],
    /// Suspicions about units, cross-sections and kinds of the tests.
    pub remarks: Vec<String>,
}

/// Most tests of a fit, whose time grows with them: about 0.2 s each.
const MAX_TESTS: usize = 64;
/// RMS error in % of the largest stress beyond which a law does not explain the tests.
const UNEXPLAINED_PERCENT: f64 = 10.0;

/// Why tests have no law.
#[derive(Debug, thiserror::Error)]
pub enum FitError {
    /// There is nothing to fit.
    #[error("expected a test, found empty lists")]
    NoTest,
    /// A fit that would take minutes.
    #[error(
        "expected at most {MAX_TESTS} tests, found {0}; join the tables of equal specimens, or fit a part of them"
    )]
    TooMany(usize),
    /// No law has stable constants over the tests.
    #[error(
        "no constants are stable over the range of the tests; look at their quantities and signs, or give a smaller --max-strain"
    )]
    Unstable,
    /// The best law is far from the tests.
    #[error(
        "no law explains the tests: RMS {rms_percent:.1} % of the largest stress, expected at most {UNEXPLAINED_PERCENT} %; look at the \
         picture (--picture), at units, signs and kinds of the tests{remarks}"
    )]
    Unexplained {
        /// Its error, % of the largest stress.
        rms_percent: f64,
        /// What is suspicious about the tests, each behind `; `.
        remarks: String,
    },
}

impl FittedSpecimens {
    /// Checks the number of tests, before they are read.
    ///
    /// # Errors
    /// None, or too many.
    pub fn check_count(tests: usize) -> Result<(), FitError> {
        match tests {
            0 => Err(FitError::NoTest),
            1..=MAX_TESTS => Ok(()),
            _ => Err(FitError::TooMany(tests)),
        }
    }

    /// Fits the families of a law, by default of every law, and chooses one.
    ///
    /// # Errors
    /// The number of tests; no constants that are stable over them.
    pub fn new(mut specimens: Vec<Specimen>, law: Option<LawName>) -> Result<Self, FitError> {
        Self::check_count(specimens.len())?;
        let families = law.map_or(&Family::ALL[..], LawName::families);
        let tests: Vec<Test> = specimens.iter().map(|specimen| specimen.test.clone()).collect();
        let candidates = fit::fit_all(families, &tests);
        let best = Fitted::best(candidates.clone()).ok_or(FitError::Unstable)?;
        specimens.iter_mut().zip(&best.moduli).for_each(|(specimen, modulus)| specimen.divide(*modulus));
        let mut remarks = remarks(&specimens, &best);
        remarks.extend(choice_remarks(families, &candidates, &best));
        Ok(Self { specimens, candidates, best, range: stretch_range(&tests), remarks })
    }

    /// Whether the law is near enough to the tests to be used.
    ///
    /// # Errors
    /// [`FitError::Unexplained`].
    pub fn check_explained(&self) -> Result<(), FitError> {
        let rms_percent = 100.0 * self.best.error;
        if rms_percent <= UNEXPLAINED_PERCENT {
            return Ok(());
        }
        let remarks = self.remarks.iter().map(|remark| format!("; {remark}")).collect();
        Err(FitError::Unexplained { rms_percent, remarks })
    }
}

/// Error at working strains above which a smaller range is suggested.
const POOR_WORKING_ERROR: f64 = 0.10;

/// Where the law is poor, and where it is simpler than the one that was asked for.
fn choice_remarks(families: &[Family], candidates: &[Fitted], best: &Fitted) -> Vec<String> {
    let mut remarks = Vec::new();
    if families.contains(&Family::MooneyRivlin) && candidates.len() == 1 {
        remarks.push("the second constant of Mooney-Rivlin would be zero: the law is neo-Hookean".into());
    }
    if let Some(error) = best.working_error.filter(|error| *error > POOR_WORKING_ERROR) {
        remarks.push(format!(
            "at strains of {:.0} to {:.0} % the law is off by {:.1} % of the stress there; for an actuator that strains less than 100 %, \
             --max-strain 1 fits closer",
            100.0 * fit::WORKING_STRAINS[0],
            100.0 * fit::WORKING_STRAINS[1],
            100.0 * error
        ));
    }
    remarks
}

fn remarks(specimens: &[Specimen], best: &Fitted) -> Vec<String> {
    let mut remarks = Vec::new();
    let shear = best.law.shear_modulus_mpa();
    if !(SHEAR_MPA[0]..=SHEAR_MPA[1]).contains(&shear) {
        remarks.push(format!(
            "initial shear modulus {shear:.3e} MPa: elastomers have {} to {} MPa; check the unit of the load (kPa, psi, MPa), the \
             cross-section and the unit of the deformation",
            SHEAR_MPA[0], SHEAR_MPA[1]
        ));
    }
    let moduli: Vec<f64> = specimens.iter().map(|specimen| initial_shear_mpa(&specimen.test)).collect();
    let median = median(moduli.iter().copied().filter(|m| m.is_finite())).unwrap_or(f64::NAN);
    for (specimen, modulus) in specimens.iter().zip(&moduli) {
        let ratio = modulus / median;
        if ratio.is_finite() && !(1.0 / MISMATCH..=MISMATCH).contains(&ratio) {
            remarks.push(format!(
                "{}: initial shear modulus {modulus:.4} MPa, {ratio:.3} times that of the others ({median:.4} MPa); check its unit, \
                 cross-section and kind",
                specimen.name
            ));
        }
    }
    for (index, specimen) in specimens.iter().enumerate().filter(|(_, specimen)| specimen.is_load_assumed) {
        if specimens.len() == 1 {
            remarks.push(
                "whether the stress is nominal or true is not identifiable from one test; --load states it"
                    .into(),
            );
            continue;
        }
        let mut tests: Vec<Test> = specimens.iter().map(|s| s.test.clone()).collect();
        tests[index].points.iter_mut().for_each(|p| p[1] /= p[0]);
        let other = fit::fit(best.family, &tests).map_or(f64::INFINITY, |fitted| fitted.error);
        if other < 0.5 * best.error {
            remarks.push(format!(
                "{} ({}): taken as true stress the error would fall from {:.2} to {:.2} %; if it is, state --load true-stress",
                specimen.name,
                specimen.kind.word(),
                100.0 * best.error,
                100.0 * other
            ));
        }
    }
    remarks
}

fn initial_shear_mpa(test: &Test) -> f64 {
    let points: Vec<[f64; 2]> =
        test.points.iter().copied().filter(|p| p[0].max(1.0 / p[0]) <= INITIAL_STRETCH).collect();
    let part = Test { points, ..test.clone() };
    if part.points.len() < 3 {
        return f64::NAN;
    }
    fit::fit(Family::NeoHookean, &[part]).map_or(f64::NAN, |fitted| fitted.law.shear_modulus_mpa())
}
