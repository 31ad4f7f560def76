//! `softtwin material fit`: constants of a silicone from its tests.

use crate::failure::{configuration, unexplained, usage};
use crate::files::{quoted, refusal, save};
use crate::picture::{Axis, Figure, Mark, Panel, Series};
use crate::report;
use anyhow::{Result, anyhow};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use fem::material::fit::{Family, Fitted};
use fem::material::{
    CurveOrigin, DeformationQuantity, FittedSpecimens, Hyperelastic, LoadQuantity, LoadingBranch, Specimen,
    TestColumn, TestDescription, TestKind, material_text, read_list,
};
use formats::log::Column;
use formats::table::TableForm;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Most tests of a fit, whose time grows with them: about 0.2 s each.
const MAX_TESTS: usize = 64;
/// RMS error in % of the largest stress beyond which a law does not explain the tests.
const UNEXPLAINED_PERCENT: f64 = 10.0;

const EXAMPLES: &str = "\
Examples:
  softtwin material fit strip.csv --out silicone.toml --picture fit.png
  softtwin material fit pull.txt --load-column 1 --load nominal-stress --load-unit MPa \\
    --deformation-column 2 --deformation strain
  softtwin material fit tests.toml --law ogden --json

FILE is a table of a test (any separator, with or without headings), or a .toml that lists several:
  [[test]]
  file = \"strip.csv\"       # columns by their headings
  [[test]]
  file = \"shear.dat\"
  test = \"planar\"          # uniaxial, planar, biaxial, compression
  deformation = { column = 2, quantity = \"length\", unit = \"mm\" }
  load = { column = 3, quantity = \"force\", unit = \"N\" }
  length_mm = 11.0
  area_mm2 = 150.0
  table = { decimal = \",\" }  # also separator, row_names, dates
  weight = 0.5
  shape_only = true      # a specimen of another modulus, which is fitted
In actuator.toml: [elastomer] file = \"silicone.toml\". Exit code 65: no law explains the tests.";

/// Fit a silicone's law to its tension, shear, biaxial and compression tests.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    Fit(FitArgs),
}

/// The values of an option that are those of an enumeration of `fem`.
macro_rules! words {
    ($enumeration:ty) => {
        PossibleValuesParser::new(<$enumeration>::WORDS).try_map(|word| word.parse::<$enumeration>())
    };
}

/// Fit a law to tests and write a material file.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
struct FitArgs {
    /// Tables of tests, or lists of them (.toml).
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,
    /// Law; by default the one that, fitted to smaller strains, predicts the larger ones best.
    #[arg(long, value_name = "LAW")]
    law: Option<Law>,
    /// Kind of test, once for all files or once per file; by default from the file's name.
    #[arg(long, value_name = "KIND", value_parser = words!(TestKind), help_heading = "Tables")]
    test: Vec<TestKind>,
    /// Column of the deformation: number from 1, or heading.
    #[arg(long, value_name = "COLUMN", value_parser = column, help_heading = "Tables")]
    deformation_column: Option<Column>,
    /// Quantity of the deformation.
    #[arg(long, value_name = "QUANTITY", value_parser = words!(DeformationQuantity), help_heading = "Tables")]
    deformation: Option<DeformationQuantity>,
    /// Unit of the deformation: 1, %, mm, m, in.
    #[arg(long, value_name = "UNIT", help_heading = "Tables")]
    deformation_unit: Option<String>,
    /// Column of the load: number from 1, or heading.
    #[arg(long, value_name = "COLUMN", value_parser = column, help_heading = "Tables")]
    load_column: Option<Column>,
    /// Quantity of the load.
    #[arg(long, value_name = "QUANTITY", value_parser = words!(LoadQuantity), help_heading = "Tables")]
    load: Option<LoadQuantity>,
    /// Unit of the load: MPa, kPa, psi, N, gf.
    #[arg(long, value_name = "UNIT", help_heading = "Tables")]
    load_unit: Option<String>,
    /// Undeformed length of the specimen in mm, for displacements and lengths.
    #[arg(long, value_name = "MM", value_parser = crate::range::number(1e-3, 1e5), help_heading = "Tables")]
    length_mm: Option<f64>,
    /// Undeformed cross-section of the specimen in mm2, for forces.
    #[arg(long, value_name = "MM2", value_parser = crate::range::number(1e-6, 1e8), help_heading = "Tables")]
    area_mm2: Option<f64>,
    /// Loading that is fitted: the first one (default), or that of the last cycle.
    #[arg(long, value_name = "BRANCH", value_parser = words!(LoadingBranch), help_heading = "Tables")]
    branch: Option<LoadingBranch>,
    /// Origin: that of the table (default); slack shifts the strain, load the stress, so that the first 30 % begin at 0.
    #[arg(long, value_name = "ORIGIN", value_parser = words!(CurveOrigin), help_heading = "Tables")]
    origin: Option<CurveOrigin>,
    /// Largest engineering strain that is fitted.
    #[arg(long, value_name = "STRAIN", default_value_t = 3.0, value_parser = crate::range::number(0.01, 100.0))]
    max_strain: f64,
    /// How much the error at strains of 2 to 30 %, relative to the stress there, counts beside that relative to the largest stress.
    #[arg(long, value_name = "WEIGHT", default_value_t = 0.2, value_parser = crate::range::number(0.0, 10.0))]
    working_weight: f64,
    /// Mass density in g/cm3, for the material file.
    #[arg(long, value_name = "G_PER_CM3", default_value_t = 1.07, value_parser = crate::range::number(0.1, 10.0))]
    density_g_per_cm3: f64,
    /// Material file.
    #[arg(long, value_name = "FILE.toml")]
    out: Option<PathBuf>,
    /// Picture of tests and law (.svg or .png).
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
    /// One JSON object instead of text.
    #[arg(long)]
    json: bool,
}

/// Laws by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Law {
    /// One constant.
    NeoHookean,
    /// Two constants; neo-Hookean where the second is not needed.
    MooneyRivlin,
    /// Two constants; stiffens towards a limit.
    Gent,
    /// Two or three constants.
    Yeoh,
    /// One to three terms.
    Ogden,
}

impl Law {
    fn families(law: Option<Self>) -> Vec<Family> {
        match law {
            None => Family::ALL.to_vec(),
            Some(Self::NeoHookean) => vec![Family::NeoHookean],
            Some(Self::MooneyRivlin) => vec![Family::NeoHookean, Family::MooneyRivlin],
            Some(Self::Gent) => vec![Family::Gent],
            Some(Self::Yeoh) => vec![Family::Yeoh2, Family::Yeoh3],
            Some(Self::Ogden) => vec![Family::Ogden1, Family::Ogden2, Family::Ogden3],
        }
    }
}

/// What a fit found.
#[derive(Serialize)]
struct FitReport {
    law: String,
    constants: BTreeMap<&'static str, f64>,
    /// `None` where the tests leave a constant open.
    half_widths_95: BTreeMap<&'static str, Option<f64>>,
    shear_modulus_mpa: f64,
    rms_percent: f64,
    /// Of the stress at strains of 2 to 30 %.
    working_strains_percent: Option<f64>,
    /// Of the rows beyond a strain, for a law fitted below it.
    beyond_fit_percent: f64,
    stretch_range: [f64; 2],
    stable_to_stretch: Option<f64>,
    tests: Vec<TestReport>,
    candidates: Vec<Candidate>,
    /// The file that was written; none if no law explains the tests.
    material: Option<PathBuf>,
    picture: Option<PathBuf>,
    remarks: Vec<String>,
}

#[derive(Serialize)]
struct TestReport {
    file: String,
    test: &'static str,
    rows: usize,
    largest_stress_mpa: f64,
    rms_percent: f64,
    working_strains_percent: Option<f64>,
    largest_error_percent: f64,
    loops_lost_percent: Vec<f64>,
    notes: Vec<String>,
}

#[derive(Serialize)]
struct Candidate {
    law: String,
    constants: usize,
    rms_percent: f64,
    working_strains_percent: Option<f64>,
    beyond_fit_percent: f64,
    stable_to_stretch: Option<f64>,
    /// A constant whose interval exceeds the constant itself: the law is no candidate.
    undetermined: Option<&'static str>,
}

/// `yeoh`, as files name the law.
fn key(law: &Hyperelastic) -> String {
    law.name().to_lowercase()
}

impl FitReport {
    fn new(fitted: &FittedSpecimens, material: Option<PathBuf>, picture: Option<PathBuf>) -> Self {
        let (best, law) = (&fitted.best, &fitted.best.law);
        let test = |specimen: &Specimen| {
            let [rms_percent, largest_error_percent] = specimen.test.error_percent(law);
            TestReport {
                file: specimen.name.clone(),
                test: specimen.kind.word(),
                rows: specimen.test.points.len(),
                largest_stress_mpa: specimen.test.largest_mpa(),
                rms_percent,
                working_strains_percent: specimen.test.working_error_percent(law),
                largest_error_percent,
                loops_lost_percent: specimen.loops.iter().map(|lost| 100.0 * lost).collect(),
                notes: specimen.notes.clone(),
            }
        };
        let candidate = |fitted: &Fitted| Candidate {
            law: key(&fitted.law),
            constants: fitted.constants(),
            rms_percent: 100.0 * fitted.error,
            working_strains_percent: fitted.working_error.map(|error| 100.0 * error),
            beyond_fit_percent: 100.0 * fitted.beyond_error,
            stable_to_stretch: fitted.stable_to,
            undetermined: fitted.undetermined(),
        };
        let names = law.constants().into_iter().map(|(name, _)| name);
        Self {
            law: key(law),
            constants: law.constants().into_iter().collect(),
            half_widths_95: names.zip(best.half_widths.iter().copied()).collect(),
            shear_modulus_mpa: law.shear_modulus_mpa(),
            rms_percent: 100.0 * best.error,
            working_strains_percent: best.working_error.map(|error| 100.0 * error),
            beyond_fit_percent: 100.0 * best.beyond_error,
            stretch_range: fitted.range,
            stable_to_stretch: best.stable_to,
            tests: fitted.specimens.iter().map(test).collect(),
            candidates: fitted.candidates.iter().map(candidate).collect(),
            material,
            picture,
            remarks: fitted.remarks.clone(),
        }
    }
}

impl Args {
    /// Runs the chosen command.
    ///
    /// # Errors
    /// Those of the command.
    pub fn run(self) -> Result<()> {
        let What::Fit(args) = self.what;
        args.run()
    }
}

impl FitArgs {
    /// Fits, and writes file and picture.
    fn run(self) -> Result<()> {
        let descriptions = self.descriptions()?;
        let specimens = descriptions
            .iter()
            .map(|test| Specimen::read(test, self.max_strain, self.working_weight).map_err(refusal));
        let fitted = FittedSpecimens::new(specimens.collect::<Result<_>>()?, &Law::families(self.law));
        let fitted = fitted.ok_or_else(|| {
            unexplained("no constants are stable over the range of the tests; look at their quantities and signs, or give a smaller --max-strain")
        })?;
        if let Some(picture) = &self.picture {
            figure(&fitted).save(picture)?;
        }
        let rms_percent = 100.0 * fitted.best.error;
        let is_explained = rms_percent <= UNEXPLAINED_PERCENT;
        let out = self.out.clone().filter(|_| is_explained);
        let mut report = FitReport::new(&fitted, out.clone(), self.picture.clone());
        if let Some(out) = &out {
            save(out, material_text(&fitted, 1.0e-9 * self.density_g_per_cm3).as_bytes())?;
            if !self.json {
                report.remarks.push(format!("in actuator.toml: [elastomer] file = {}", quoted(out)));
            }
        }
        report::print(&report, self.json)?;
        if is_explained {
            return Ok(());
        }
        let remarks: String = fitted.remarks.iter().map(|remark| format!("; {remark}")).collect();
        Err(unexplained(format!(
            "no law explains the tests: RMS {rms_percent:.1} % of the largest stress, expected at most {UNEXPLAINED_PERCENT} %; look at the \
             picture (--picture), at units, signs and kinds of the tests{remarks}"
        )))
    }

    fn descriptions(&self) -> Result<Vec<TestDescription>> {
        let is_list = |path: &PathBuf| path.extension().is_some_and(|ending| ending == "toml");
        let tables = self.files.iter().filter(|path| !is_list(path)).count();
        let of_tables = [
            ("--test", !self.test.is_empty()),
            ("--deformation-column", self.deformation_column.is_some()),
            ("--deformation", self.deformation.is_some()),
            ("--deformation-unit", self.deformation_unit.is_some()),
            ("--load-column", self.load_column.is_some()),
            ("--load", self.load.is_some()),
            ("--load-unit", self.load_unit.is_some()),
            ("--length-mm", self.length_mm.is_some()),
            ("--area-mm2", self.area_mm2.is_some()),
            ("--branch", self.branch.is_some()),
            ("--origin", self.origin.is_some()),
        ];
        if let (0, Some((option, _))) = (tables, of_tables.iter().find(|(_, is_given)| *is_given)) {
            return Err(usage(format!(
                "{option}: expected a table, found lists only; give it as a key of [[test]]"
            )));
        }
        if self.test.len() > 1 && self.test.len() != tables {
            return Err(usage(format!(
                "--test: expected once, or once for each of the {tables} tables, found {} times",
                self.test.len()
            )));
        }
        let (mut all, mut at) = (Vec::new(), 0);
        for file in &self.files {
            if is_list(file) {
                all.extend(read_list(file).map_err(refusal)?);
                continue;
            }
            all.push(TestDescription {
                file: file.clone(),
                table: TableForm::default(),
                test: self.test.get(if self.test.len() == 1 { 0 } else { at }).copied(),
                weight: 1.0,
                shape_only: false,
                deformation: TestColumn {
                    column: self.deformation_column.clone(),
                    quantity: self.deformation,
                    unit: self.deformation_unit.clone(),
                },
                load: TestColumn {
                    column: self.load_column.clone(),
                    quantity: self.load,
                    unit: self.load_unit.clone(),
                },
                length_mm: self.length_mm,
                area_mm2: self.area_mm2,
                branch: self.branch.unwrap_or_default(),
                origin: self.origin.unwrap_or_default(),
            });
            at += 1;
        }
        if all.is_empty() {
            return Err(configuration(anyhow!("expected a test, found empty lists")));
        }
        let count = all.len();
        if count > MAX_TESTS {
            return Err(configuration(anyhow!(
                "expected at most {MAX_TESTS} tests, found {count}; join the tables of equal specimens, or fit a part of them"
            )));
        }
        Ok(all)
    }
}

fn column(text: &str) -> Result<Column, String> {
    Ok(text.parse().map_or_else(|_| Column::Heading(text.to_owned()), Column::Number))
}

/// Most points of a drawn test.
const DRAWN: usize = 400;

/// Tests with the law, and their differences.
fn figure(fitted: &FittedSpecimens) -> Figure {
    let law = &fitted.best.law;
    let mut panels = Vec::new();
    for specimen in &fitted.specimens {
        let thinned = |points: &[[f64; 2]]| -> Vec<(f64, f64)> {
            let step = points.len().div_ceil(DRAWN).max(1);
            points.iter().step_by(step).map(|p| (p[0], p[1])).collect()
        };
        let points = &specimen.test.points;
        let (low, high) = points.iter().fold((1.0_f64, 1.0_f64), |(a, b), p| (a.min(p[0]), b.max(p[0])));
        let curve: Vec<(f64, f64)> = (0..=200)
            .map(|k| low + (high - low) * f64::from(k) / 200.0)
            .filter_map(|l| Some((l, law.nominal_stress_mpa(specimen.test.deformation, l)?)))
            .collect();
        let within: Vec<[f64; 2]> = specimen
            .rows
            .iter()
            .copied()
            .filter(|row| row[0] <= high + 0.02 && row[0] >= low - 0.02)
            .collect();
        let largest = specimen.test.largest_mpa();
        let off: Vec<(f64, f64)> = points
            .iter()
            .filter_map(|p| {
                Some((
                    p[0],
                    100.0 * (law.nominal_stress_mpa(specimen.test.deformation, p[0])? - p[1]) / largest,
                ))
            })
            .collect();
        let series = |name: &str, colour, mark, points| Series { name: name.into(), colour, mark, points };
        let mut drawn = vec![series("measured", 4, Mark::Line, thinned(&within))];
        drawn.push(series("fitted rows", 0, Mark::Dots, thinned(points)));
        drawn.push(series(&key(law), 1, Mark::Line, curve));
        panels.push(Panel {
            title: format!("{} ({})", specimen.name, specimen.kind.word()),
            x: Axis::linear("stretch"),
            y: Axis::linear("nominal stress [MPa]"),
            series: drawn,
            map: None,
        });
        panels.push(Panel {
            title: String::new(),
            x: Axis::linear("stretch"),
            y: Axis::linear("law - measured [% of the largest stress]"),
            series: vec![series("", 1, Mark::Dots, off)],
            map: None,
        });
    }
    let title = format!("{}: RMS {:.2} % of the largest stress", key(law), 100.0 * fitted.best.error);
    Figure { title, panels, columns: 2 }
}
