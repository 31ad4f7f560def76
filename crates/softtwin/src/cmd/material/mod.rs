//! `softtwin material fit`: constants of a silicone from its tests.

mod figure;

use crate::failure::{configuration, unexplained, usage};
use crate::files::{quoted, refusal, save};
use crate::report;
use anyhow::Result;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use fem::material::{
    CurveOrigin, DeformationQuantity, FitReport, FittedSpecimens, LawName, LoadQuantity, LoadingBranch,
    Specimen, TestColumn, TestDescription, TestKind, material_text, read_list,
};
use figure::figure;
use formats::log::Column;
use formats::table::TableForm;
use std::path::PathBuf;

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
    #[arg(long, value_name = "LAW", value_parser = words!(LawName))]
    law: Option<LawName>,
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
        let fitted =
            FittedSpecimens::new(specimens.collect::<Result<_>>()?, self.law).map_err(unexplained)?;
        if let Some(picture) = &self.picture {
            figure(&fitted).save(picture)?;
        }
        let explained = fitted.check_explained();
        let out = self.out.clone().filter(|_| explained.is_ok());
        let mut report = FitReport::new(&fitted, out.clone(), self.picture.clone());
        if let Some(out) = &out {
            save(out, material_text(&fitted, 1.0e-9 * self.density_g_per_cm3).as_bytes())?;
            if !self.json {
                report.remarks.push(format!("in actuator.toml: [elastomer] file = {}", quoted(out)));
            }
        }
        report::print(&report, self.json)?;
        explained.map_err(unexplained)
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
        FittedSpecimens::check_count(all.len()).map_err(configuration)?;
        Ok(all)
    }
}

fn column(text: &str) -> Result<Column, String> {
    Ok(text.parse().map_or_else(|_| Column::Heading(text.to_owned()), Column::Number))
}
