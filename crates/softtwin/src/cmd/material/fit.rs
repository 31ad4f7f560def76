//! `softtwin material fit`.

use super::description::{self, Branch, Channel, Description, Extension, Kind, Load, Origin};
use super::report::{Report, figure, material_file};
use super::specimen::{Specimen, kind_name};
use crate::failure::{configuration, unexplained, usage};
use crate::files::{quoted, save};
use crate::output;
use anyhow::{Result, anyhow};
use fem::material::fit::{self, Family, Fitted, Test, stretch_range};
use formats::log::Column;
use std::path::PathBuf;

/// Most tests of a fit, whose time grows with them: about 0.2 s each.
const MAX_TESTS: usize = 64;

pub(super) const EXAMPLES: &str = "\
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
  weight = 0.5
  shape_only = true      # a specimen of another modulus, which is fitted
In actuator.toml: [elastomer] file = \"silicone.toml\". Exit code 65: no law explains the tests.";

/// Fit a law to tests and write a material file.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Tables of tests, or lists of them (.toml).
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,
    /// Law; by default the one with the smallest error on parts left out, preferring laws that are stable everywhere.
    #[arg(long, value_name = "LAW")]
    law: Option<Law>,
    /// Kind of test, once for all files or once per file; by default from the file's name.
    #[arg(long, value_name = "KIND", help_heading = "Tables")]
    test: Vec<Kind>,
    /// Column of the deformation: number from 1, or heading.
    #[arg(long, value_name = "COLUMN", value_parser = column, help_heading = "Tables")]
    deformation_column: Option<Column>,
    /// Quantity of the deformation.
    #[arg(long, value_name = "QUANTITY", help_heading = "Tables")]
    deformation: Option<Extension>,
    /// Unit of the deformation: 1, %, mm, m, in.
    #[arg(long, value_name = "UNIT", help_heading = "Tables")]
    deformation_unit: Option<String>,
    /// Column of the load: number from 1, or heading.
    #[arg(long, value_name = "COLUMN", value_parser = column, help_heading = "Tables")]
    load_column: Option<Column>,
    /// Quantity of the load.
    #[arg(long, value_name = "QUANTITY", help_heading = "Tables")]
    load: Option<Load>,
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
    #[arg(long, value_name = "BRANCH", help_heading = "Tables")]
    branch: Option<Branch>,
    /// Origin: that of the table (default); slack shifts the strain, load the stress, so that the first 30 % begin at 0.
    #[arg(long, value_name = "ORIGIN", help_heading = "Tables")]
    origin: Option<Origin>,
    /// Largest engineering strain that is fitted.
    #[arg(long, value_name = "STRAIN", default_value_t = 3.0, value_parser = crate::range::number(0.01, 100.0))]
    max_strain: f64,
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
pub enum Law {
    /// One constant.
    NeoHookean,
    /// Two constants.
    MooneyRivlin,
    /// Two constants; stiffens towards a limit.
    Gent,
    /// Three constants.
    Yeoh,
    /// Two or three terms.
    Ogden,
}

impl Law {
    fn families(law: Option<Self>) -> Vec<Family> {
        match law {
            None => {
                use Family::{Gent, MooneyRivlin, NeoHookean, Ogden2, Ogden3, Yeoh};
                vec![NeoHookean, MooneyRivlin, Gent, Yeoh, Ogden2, Ogden3]
            }
            Some(Self::NeoHookean) => vec![Family::NeoHookean],
            Some(Self::MooneyRivlin) => vec![Family::MooneyRivlin],
            Some(Self::Gent) => vec![Family::Gent],
            Some(Self::Yeoh) => vec![Family::Yeoh],
            Some(Self::Ogden) => vec![Family::Ogden2, Family::Ogden3],
        }
    }
}

/// RMS error in % of the largest stress beyond which a law does not explain the tests.
const UNEXPLAINED_PERCENT: f64 = 10.0;
/// Initial shear moduli of elastomers, MPa: from gels to hard polyurethane.
const SHEAR_MPA: [f64; 2] = [5e-4, 12.0];
/// Ratio of initial shear moduli of two tests of one material that is no scatter.
const MISMATCH: f64 = 2.5;
/// Stretch up to which initial shear moduli are compared.
const INITIAL_STRETCH: f64 = 1.5;

impl Args {
    /// Fits, and writes file and picture.
    ///
    /// # Errors
    /// Tables that cannot be read; tests that no stable law explains; I/O errors.
    pub fn run(self) -> Result<()> {
        let descriptions = self.descriptions()?;
        let mut specimens: Vec<Specimen> = descriptions
            .iter()
            .map(|description| Specimen::read(description, self.max_strain))
            .collect::<Result<_>>()?;
        let tests: Vec<Test> = specimens.iter().map(|specimen| specimen.test.clone()).collect();
        let candidates = fit::fit_all(&Law::families(self.law), &tests);
        let best = Fitted::best(candidates.clone()).ok_or_else(|| {
            unexplained("no constants are stable over the range of the tests; look at their quantities and signs, or give a smaller --max-strain")
        })?;
        specimens.iter_mut().zip(&best.moduli).for_each(|(specimen, modulus)| specimen.divide(*modulus));
        let remarks = remarks(&specimens, &best);
        let report = Report {
            specimens: &specimens,
            candidates: &candidates,
            best: &best,
            range: stretch_range(&tests),
            remarks: &remarks,
            density_t_per_mm3: 1.0e-9 * self.density_g_per_cm3,
        };
        if let Some(picture) = &self.picture {
            figure(&report).save(picture)?;
        }
        let is_explained = 100.0 * best.error <= UNEXPLAINED_PERCENT;
        if let Some(out) = self.out.as_ref().filter(|_| is_explained) {
            save(out, material_file(&report).as_bytes())?;
        }
        if self.json {
            output::json(
                &report.json(self.out.as_deref().filter(|_| is_explained), self.picture.as_deref()),
            )?;
        } else {
            output!("{}", report.text())?;
            if let Some(out) = self.out.as_ref().filter(|_| is_explained) {
                output!("written: {}; in actuator.toml: [elastomer] file = {}", out.display(), quoted(out))?;
            }
        }
        if is_explained {
            return Ok(());
        }
        Err(unexplained(format!(
            "no law explains the tests: RMS {:.1} % of the largest stress, expected at most {UNEXPLAINED_PERCENT} %; look at the picture \
             (--picture), at units, signs and kinds of the tests{}",
            100.0 * best.error,
            if remarks.is_empty() { String::new() } else { format!("; {}", remarks.join("; ")) }
        )))
    }

    fn descriptions(&self) -> Result<Vec<Description>> {
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
                all.extend(description::read(file)?);
                continue;
            }
            all.push(Description {
                file: file.clone(),
                test: self.test.get(if self.test.len() == 1 { 0 } else { at }).copied(),
                weight: 1.0,
                shape_only: false,
                deformation: Channel {
                    column: self.deformation_column.clone(),
                    quantity: self.deformation,
                    unit: self.deformation_unit.clone(),
                },
                load: Channel {
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

/// Suspicions about units, cross-sections and kinds of the tests.
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
    let mut sorted: Vec<f64> = moduli.iter().copied().filter(|m| m.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let median = sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN);
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
    for (at, specimen) in specimens.iter().enumerate().filter(|(_, specimen)| specimen.is_load_assumed) {
        if specimens.len() == 1 {
            remarks.push(
                "whether the stress is nominal or true is not identifiable from one test; --load states it"
                    .into(),
            );
            continue;
        }
        let mut tests: Vec<Test> = specimens.iter().map(|s| s.test.clone()).collect();
        tests[at].points.iter_mut().for_each(|p| p[1] /= p[0]);
        let other = fit::fit(best.family, &tests).map_or(f64::INFINITY, |fitted| fitted.error);
        if other < 0.5 * best.error {
            remarks.push(format!(
                "{} ({}): taken as true stress the error would fall from {:.2} to {:.2} %; if it is, state --load true-stress",
                specimen.name,
                kind_name(specimen.kind),
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
