//! `softtwin import results`: a database from finished simulations.

use super::found::ResultsReport;
use crate::failure::usage;
use crate::files::{not_imported, refusal};
use crate::report;
use anyhow::Result;
use formats::FormatError;
use formats::database;
use formats::results::{ImportOptions, InputSource, Wanted, collect, plain_name};
use formats::table::Table;
use formats::unit::{Dimension, known_of, unit};
use formats::vtu::Cells;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  CalculiX, one job per state, inputs in a table (columns file, load_n, thickness_mm):
    softtwin import results jobs/*.frd --out db --length-unit mm \\
      --stress-unit mpa --inputs inputs.csv
  ParaView or meshio, inputs in the file names:
    softtwin import results beam_f*.vtu \\
      --pattern 'beam_f{load_n}_t{thickness_mm}.vtu' --out db \\
      --length-unit mm --stress-unit mpa
  Every increment of one job is a state, the load grows with the time:
    softtwin import results ramp.frd --steps all --ramp load_n=2.5 \\
      --out db --length-unit mm --stress-unit mpa --field ENER=mJ/mm3
then
    softtwin train --database db --out beam.twin
    softtwin predict beam.twin --set load_n=1.2 --set thickness_mm=4

Reads .frd (CalculiX, text), .vtu, .pvd, Abaqus' .inp with a .csv or .npz of the same name, NumPy's .npz, folders of .npy arrays. \
softtwin-convert (Python client) makes such files of .xdmf, .xplt, .cdb with tables or listings, .rpt and others: docs/import.md. \
An input's name ends in its unit (load_n, stiffness_mpa; _1 for plain numbers). pressure_mpa and gap_mm are those of an actuator \
over a plate; a state with a gap needs contact_force_n in the table. Steps that did not converge are left out and named.";

/// A database from finished simulations (CalculiX, VTK, Abaqus, NumPy).
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Files or folders, one simulation each; without, those in the table of inputs.
    #[arg(value_name = "PATH", required_unless_present = "inputs")]
    paths: Vec<PathBuf>,
    /// Folder of the database.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Replace the database there.
    #[arg(long)]
    replace: bool,
    /// Unit of length in the files.
    #[arg(long = "length-unit", value_name = "UNIT", value_parser = |text: &str| factor(text, Dimension::Length))]
    length_mm: f64,
    /// Unit of stress in the files; needed where they hold a stress.
    #[arg(long = "stress-unit", value_name = "UNIT", value_parser = |text: &str| factor(text, Dimension::Pressure))]
    stress_mpa: Option<f64>,
    /// Table of inputs: columns file, the inputs, and where needed step, case, regime, split, contact_force_n.
    #[arg(long, value_name = "FILE.csv")]
    inputs: Option<PathBuf>,
    /// Inputs in the file names, as run_p{pressure_mpa}_g{gap_mm}_*.frd or job_{load_n}/results.frd; * is any text.
    #[arg(long)]
    pattern: Option<String>,
    /// An input that grows with the time of the step; its value at time 1, unless table or pattern give it.
    #[arg(long, value_name = "NAME[=VALUE]")]
    ramp: Option<String>,
    /// Which steps of a simulation become states.
    #[arg(long, value_enum, default_value = "last")]
    steps: Steps,
    /// Name of the displacement in the files, where it is none of DISP, U, displacement.
    #[arg(long, value_name = "NAME")]
    displacement: Option<String>,
    /// Name of the stress (tensor or von Mises), where it is none of STRESS, S, von_mises, mises, SEQV.
    #[arg(long, value_name = "NAME")]
    stress: Option<String>,
    /// A further field, with its unit: NAME of a scalar, NAME.COMPONENT otherwise. Repeat for others.
    #[arg(long = "field", value_name = "NAME=UNIT", value_parser = field)]
    fields: Vec<(String, String)>,
    /// Node set whose total force, which CalculiX prints into the .dat beside the .frd (N), is the contact force of states that have a gap
    /// and no force in the table: its length.
    #[arg(long, value_name = "SET")]
    force_from: Option<String>,
    /// Every N-th state that has no smallest or largest input is for testing (2 to 1000000000), unless the table has a column split.
    #[arg(long, value_name = "N", value_parser = crate::range::count(2, 1_000_000_000))]
    test_every: Option<usize>,
    /// Name of what was simulated; the folder's name when left out (of NAME/database: NAME).
    #[arg(long)]
    name: Option<String>,
    /// End with one JSON object.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Steps {
    Last,
    All,
}

/// Factor of a unit to mm or MPa.
fn factor(text: &str, wanted: Dimension) -> Result<f64, String> {
    let found = unit(text).filter(|(quantity, _)| *quantity == wanted);
    found.map(|(_, factor)| factor).ok_or_else(|| format!("expected one of {}", known_of(wanted)))
}

fn field(text: &str) -> Result<(String, String), String> {
    let pair = text.split_once('=').filter(|(name, unit)| !name.is_empty() && !unit.is_empty());
    let pair = pair.map(|(name, unit)| (name.to_owned(), unit.to_owned()));
    pair.ok_or_else(|| format!("expected NAME=UNIT, such as ENER=mJ/mm3 or NDTEMP=K; found {text:?}"))
}

impl Args {
    /// Reads all simulations, writes the database, says what was left out.
    ///
    /// # Errors
    /// Errors in a file, a step or an input, by name.
    pub fn run(self) -> Result<()> {
        if !self.replace && self.out.join("database.toml").exists() {
            let found = format!("a database in {}", self.out.display());
            return Err(usage(format!(
                "--out: expected a new folder, found {found}; name another, or --replace it"
            )));
        }
        let wanted = Wanted {
            length_mm: self.length_mm,
            stress_mpa: self.stress_mpa,
            displacement: self.displacement.clone(),
            stress: self.stress.clone(),
            fields: self.fields.clone(),
        };
        let source = self.source()?;
        let paths = if self.paths.is_empty() { source.files().map_err(refusal)? } else { self.paths.clone() };
        let options = ImportOptions {
            wanted,
            all_steps: self.steps == Steps::All,
            force_from: self.force_from.as_deref(),
            test_every: self.test_every,
            name: self.name.clone().unwrap_or_else(|| plain_name(subject(&self.out))),
        };
        let states = collect(&paths, &source, options).map_err(not_imported)?;
        // Until the new one is whole, there is none.
        if self.replace {
            let old = self.out.join("database.toml");
            if old.exists() {
                std::fs::remove_file(&old).map_err(|error| refusal(FormatError::write(&old, error)))?;
            }
        }
        database::write(&self.out, &states.database, Cells::Mixed(&states.blocks)).map_err(refusal)?;
        report::print(&ResultsReport::new(&self.out, states), self.json)
    }

    fn source(&self) -> Result<InputSource<'_>> {
        let ramp = self.ramp.as_deref().map(|text| {
            let Some((name, value)) = text.split_once('=') else { return Ok((text, None)) };
            let value = value.parse::<f64>().ok().filter(|value| value.is_finite());
            let value = value
                .ok_or_else(|| usage(format!("--ramp: expected NAME or NAME=NUMBER, found {text:?}")))?;
            anyhow::Ok((name, Some(value)))
        });
        let table =
            self.inputs.as_deref().map(|path| anyhow::Ok((path, Table::read(path, true).map_err(refusal)?)));
        let table = table.transpose()?;
        if table.is_none() && self.pattern.is_none() && self.ramp.is_none() {
            return Err(usage(
                "expected the inputs of the states: --inputs FILE.csv, --pattern or --ramp; found none",
            ));
        }
        Ok(InputSource { table, pattern: self.pattern.as_deref(), ramp: ramp.transpose()? })
    }
}

/// Name of a folder's content: of `part/database` the part.
fn subject(out: &Path) -> &Path {
    let parent = out.parent().filter(|parent| parent.file_name().is_some());
    parent.filter(|_| out.file_name().is_some_and(|name| name == "database")).unwrap_or(out)
}
