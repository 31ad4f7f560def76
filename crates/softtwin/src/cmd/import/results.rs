//! `softtwin import results`: a database from finished simulations.

use super::inputs::{Labels, Source, table, unit};
use crate::cmd::mesh::body::{BodyReport, rounded};
use crate::failure::{configuration, usage};
use crate::files::refusal;
use crate::output;
use anyhow::{Result, anyhow};
use formats::database::{self, ANY_REGIME};
use formats::results::{self, Assembly, Wanted};
use formats::vtu::Cells;
use formats::{Diagnostic, FormatError};
use rom::inputs::{MAX_INPUTS, PARAMETERS, Parameter};
use rom::snapshots::{Case, Database, RegimeKind, Split};
use serde_json::json;
use std::collections::BTreeMap;
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
    #[arg(long, value_enum)]
    length_unit: Length,
    /// Unit of stress in the files; needed where they hold a stress.
    #[arg(long, value_enum)]
    stress_unit: Option<Stress>,
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

#[derive(Clone, Copy, clap::ValueEnum)]
enum Length {
    Um,
    Mm,
    Cm,
    M,
    In,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Stress {
    Pa,
    Kpa,
    Mpa,
    Gpa,
    Psi,
}

#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Steps {
    Last,
    All,
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
            length_mm: match self.length_unit {
                Length::Um => 1e-3,
                Length::Mm => 1.0,
                Length::Cm => 10.0,
                Length::M => 1e3,
                Length::In => 25.4,
            },
            stress_mpa: self.stress_unit.map(|unit| match unit {
                Stress::Pa => 1e-6,
                Stress::Kpa => 1e-3,
                Stress::Mpa => 1.0,
                Stress::Gpa => 1e3,
                Stress::Psi => 0.006_894_757_293_168_361,
            }),
            displacement: self.displacement.clone(),
            stress: self.stress.clone(),
            fields: self.fields.clone(),
        };
        let mut states = States {
            assembly: Assembly::new(wanted),
            known: Vec::new(),
            has_split: Vec::new(),
            left_out: Vec::new(),
            names: Vec::new(),
        };
        let source = self.source()?;
        let paths = if self.paths.is_empty() { source.files()? } else { self.paths.clone() };
        for path in &paths {
            let namesakes = paths.iter().filter(|other| other.file_stem() == path.file_stem()).count();
            let folder = path.parent().filter(|_| namesakes > 1).and_then(Path::file_name);
            let name =
                folder.map_or(plain(path), |folder| format!("{}-{}", plain(Path::new(folder)), plain(path)));
            states.simulation(path, &name, &source, &self)?;
        }
        states.left_out.extend(source.unused(&paths));
        let nodes = states.assembly.nodes();
        let shape_varies = states.assembly.shape_varies();
        let left_out = [states.assembly.parts_left_out(), &states.left_out].concat();
        let parameters = parameters(&states.names, &states.known)?;
        let name = self.name.clone().unwrap_or_else(|| plain(subject(&self.out)));
        let (mut database, blocks) = states
            .assembly
            .finish(name, parameters)
            .map_err(|error| configuration(anyhow!("{error}{}", listed(&left_out))))?;
        if let Some(every) = self.test_every {
            hold_back(&mut database.cases, &states.known, &states.has_split, every);
        }
        // Until the new one is whole, there is none.
        if self.replace {
            let old = self.out.join("database.toml");
            if old.exists() {
                std::fs::remove_file(&old).map_err(|error| refusal(FormatError::write(&old, error)))?;
            }
        }
        database::write(&self.out, &database, Cells::Mixed(&blocks)).map_err(refusal)?;
        let body = BodyReport::of(database.undeformed_mm.as_deref().unwrap_or_default(), &blocks);
        self.report(&database, nodes, shape_varies, &left_out, body)
    }

    fn source(&self) -> Result<Source<'_>> {
        let ramp = self.ramp.as_deref().map(|text| {
            let Some((name, value)) = text.split_once('=') else { return Ok((text, None)) };
            let value = value.parse::<f64>().ok().filter(|value| value.is_finite());
            let value = value
                .ok_or_else(|| usage(format!("--ramp: expected NAME or NAME=NUMBER, found {text:?}")))?;
            anyhow::Ok((name, Some(value)))
        });
        let table = self.inputs.as_deref().map(table).transpose()?;
        if table.is_none() && self.pattern.is_none() && self.ramp.is_none() {
            return Err(usage(
                "expected the inputs of the states: --inputs FILE.csv, --pattern or --ramp; found none",
            ));
        }
        Ok(Source { table, pattern: self.pattern.as_deref(), ramp: ramp.transpose()? })
    }

    fn report(
        &self,
        database: &Database,
        nodes: usize,
        shape_varies: bool,
        left_out: &[String],
        mut body: BodyReport,
    ) -> Result<()> {
        let largest = Largest::of(database);
        largest.doubt(&mut body);
        let ranges = ranges(database);
        let fields: Vec<&str> = database.fields.iter().map(|field| field.name.as_str()).collect();
        let of = |split| database.of_split(split).count();
        let (train, test) = (of(Split::Train), database.cases.len() - of(Split::Train));
        if self.json {
            return output::json(&json!({
                "out": self.out, "nodes": nodes, "states": database.cases.len(), "training": train, "testing": test,
                "fields": fields, "inputs": database.parameters.iter().map(|p| &p.name).collect::<Vec<_>>(),
                "shape_varies": shape_varies, "left_out": left_out, "body": body.json(),
                "ranges": ranges.iter().cloned().collect::<BTreeMap<_, _>>(),
                "largest_displacement_mm": largest.displacement_mm, "largest_stress_mpa": largest.stress_mpa,
            }));
        }
        output!(
            "{}: {train} states to train on, {test} to test, {nodes} nodes, fields {}",
            self.out.display(),
            fields.join(", ")
        )?;
        for (name, [low, high]) in &ranges {
            let parameter = database.parameters.iter().find(|parameter| parameter.name == *name);
            let said = parameter.map_or_else(String::new, |parameter| {
                format!(" {}; {:.6} (the mean) where nothing is said", parameter.unit, parameter.nominal)
            });
            output!("input {name}, {} to {}{said}", rounded(*low), rounded(*high))?;
        }
        let stress =
            largest.stress_mpa.map_or_else(String::new, |mpa| format!(", stress {} MPa", rounded(mpa)));
        output!("largest displacement {} mm{stress}", rounded(largest.displacement_mm))?;
        if shape_varies {
            output!("the undeformed shape differs between simulations: mesh.vtu is that of the first one")?;
        }
        for reason in left_out {
            output!("left out: {reason}")?;
        }
        body.print()
    }
}

/// Range of each input over all states; of the gap over those that have one.
fn ranges(database: &Database) -> Vec<(String, [f64; 2])> {
    let over = |name: &str, values: Vec<f64>| -> Option<(String, [f64; 2])> {
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        (low <= high).then(|| (name.to_owned(), [low, high]))
    };
    let cases = &database.cases;
    let pressure = over("pressure_mpa", cases.iter().map(|case| case.pressure_mpa).collect());
    let gap = over("gap_mm", cases.iter().filter_map(|case| case.gap_mm).collect());
    let parameters = database.parameters.iter().enumerate();
    let parameters =
        parameters.filter_map(|(k, p)| over(&p.name, cases.iter().map(|case| case.parameters[k]).collect()));
    // A body that has other inputs has no pressure: it is 0 in every state.
    let is_given = |(_, range): &(String, [f64; 2])| database.parameters.is_empty() || *range != [0.0; 2];
    pressure.filter(is_given).into_iter().chain(gap).chain(parameters).collect()
}

/// Largest values of all states.
struct Largest {
    displacement_mm: f64,
    /// `None` without a stress.
    stress_mpa: Option<f64>,
}

/// Stress from which a body that moves far is not of rubber (MPa): it tears.
const TORN_MPA: f64 = 10.0;

impl Largest {
    fn of(database: &Database) -> Self {
        let largest = |name: &str| {
            let field = database.fields.iter().position(|field| field.name == name)?;
            let states = 0..database.cases.len();
            Some(
                states
                    .flat_map(|case| database.field(case, field))
                    .map(|v| f64::from(v.abs()))
                    .fold(0.0, f64::max),
            )
        };
        Self { displacement_mm: largest("displacement").unwrap_or(0.0), stress_mpa: largest("von_mises") }
    }

    /// Remarks on values that can hardly be meant.
    fn doubt(&self, body: &mut BodyReport) {
        let share = self.displacement_mm / body.largest_mm();
        if share > 10.0 {
            body.remark(format!(
                "the body moves by {} times its length: do lengths and displacements have one unit?",
                rounded(share)
            ));
        }
        if let Some(mpa) = self.stress_mpa.filter(|mpa| *mpa > TORN_MPA && share > 0.1) {
            body.remark(format!(
                "the body bends by {:.0} % of its length at {} MPa, and rubber tears at some {TORN_MPA} MPa: is --stress-unit that of \
                 the files?",
                100.0 * share,
                rounded(mpa)
            ));
        }
    }
}

/// Collected states.
struct States {
    assembly: Assembly,
    /// Where each state comes from, and its inputs.
    known: Vec<(String, BTreeMap<String, f64>)>,
    /// Whether the table has a split for it.
    has_split: Vec<bool>,
    left_out: Vec<String>,
    /// Names of the inputs, those of the first state.
    names: Vec<String>,
}

impl States {
    fn simulation(&mut self, path: &Path, name: &str, source: &Source<'_>, args: &Args) -> Result<()> {
        let run = results::read(path).map_err(refusal)?;
        self.left_out.extend(run.left_out.iter().map(|reason| format!("{}, {reason}", path.display())));
        if run.steps.is_empty() {
            self.left_out.push(format!("{}: no step that is a state", path.display()));
        }
        let states = source.states(path, &run, args.steps == Steps::All)?;
        let several = states.len() > 1;
        for (at, mut labels) in states {
            let step = &run.steps[at];
            let place = format!("{}, {}", path.display(), step.name);
            let wanted = labels.contact_force_n.is_none() && labels.values.contains_key("gap_mm");
            if let Some(set) = args.force_from.as_ref().filter(|_| wanted) {
                labels.contact_force_n = Some(force_from(set, &run, step, path)?);
            }
            let suffix = if several { format!("-{}", at + 1) } else { String::new() };
            let name = labels.name.clone().unwrap_or_else(|| format!("{name}{suffix}"));
            let inputs = self.inputs(&place, &labels)?;
            let case = case(&place, name, &labels)?;
            match self.assembly.add(path, &run, step, case).map_err(refusal)? {
                Some(reason) => self.left_out.push(format!("{}, {reason}", path.display())),
                None => {
                    self.known.push((place, inputs));
                    self.has_split.push(labels.split.is_some());
                }
            }
        }
        Ok(())
    }

    /// The inputs: named as the first state's, and of no other state.
    fn inputs(&mut self, place: &str, labels: &Labels) -> Result<BTreeMap<String, f64>> {
        let found: Vec<&String> = labels.values.keys().filter(|name| *name != "gap_mm").collect();
        if self.names.is_empty() {
            self.names = found.iter().map(|name| (*name).clone()).collect();
        }
        if self.names.is_empty() || found != self.names.iter().collect::<Vec<_>>() {
            let expected = self.names.join(", ");
            let error =
                anyhow!("{place}: expected the inputs {expected} as for the first state, found {found:?}");
            return Err(configuration(error));
        }
        if let Some((twin, _)) = self.known.iter().find(|(_, other)| *other == labels.values) {
            let error = anyhow!(
                "{place}: expected inputs that no other state has, found those of {twin} ({:?}); --ramp or a column step \
                 tell steps apart",
                labels.values
            );
            return Err(configuration(error));
        }
        Ok(labels.values.clone())
    }
}

/// A state; for training unless the table has another split.
fn case(place: &str, name: String, labels: &Labels) -> Result<Case> {
    let gap_mm = labels.values.get("gap_mm").copied();
    let regime = regime(place, labels, gap_mm.is_some())?;
    if regime == RegimeKind::Contact && (gap_mm.is_none() || labels.contact_force_n.is_none()) {
        let error = anyhow!(
            "{place}: expected gap_mm and contact_force_n in the table for a state in contact (force 0 where nothing \
                 touches), found one without"
        );
        return Err(configuration(error));
    }
    let further = labels.values.iter().filter(|(name, _)| !is_operating(name));
    Ok(Case {
        name,
        regime,
        split: labels.split.unwrap_or(Split::Train),
        pressure_mpa: labels.values.get("pressure_mpa").copied().unwrap_or(0.0),
        gap_mm,
        contact_force_n: labels.contact_force_n.unwrap_or(0.0),
        parameters: further.map(|(_, value)| *value).collect(),
    })
}

/// Marks every N-th state for testing among those that lie inside: without them the training range stays what it is.
fn hold_back(
    cases: &mut [Case],
    known: &[(String, BTreeMap<String, f64>)],
    has_split: &[bool],
    every: usize,
) {
    let extreme = |name: &String, pick: fn(f64, f64) -> f64| {
        known.iter().filter_map(|(_, values)| values.get(name)).copied().reduce(pick)
    };
    let ends: BTreeMap<&String, [Option<f64>; 2]> = known
        .iter()
        .flat_map(|(_, values)| values.keys())
        .map(|name| (name, [extreme(name, f64::min), extreme(name, f64::max)]))
        .collect();
    let varies = |name: &String| ends[name][0] != ends[name][1];
    let is_inside = |values: &BTreeMap<String, f64>| {
        values.iter().all(|(name, value)| !varies(name) || !ends[name].contains(&Some(*value)))
    };
    let inside = cases
        .iter_mut()
        .zip(known)
        .zip(has_split)
        .filter(|((_, (_, values)), split)| !**split && is_inside(values));
    for ((case, _), _) in inside.skip(every - 1).step_by(every) {
        case.split = Split::Test;
    }
}

/// Regime of a state: the named one, else contact if there is a gap.
fn regime(place: &str, labels: &Labels, has_gap: bool) -> Result<RegimeKind> {
    match labels.regime.as_deref() {
        Some("free") => Ok(RegimeKind::Free),
        Some("contact") => Ok(RegimeKind::Contact),
        None => Ok(if has_gap { RegimeKind::Contact } else { RegimeKind::Free }),
        Some(found) => {
            let error = Diagnostic::new(format!("{place}, regime"), ANY_REGIME, format!("`{found}`"));
            Err(configuration(anyhow!("{error}")))
        }
    }
}

/// The contact force of a step, from what the solver printed beside its results.
fn force_from(set: &str, run: &results::Run, step: &results::Step, path: &Path) -> Result<f64> {
    run.total_force(set, step).map_err(|sets| {
        let found = if sets.is_empty() { "none".to_owned() } else { sets.join(", ") };
        let expected = format!(
            "the total force of {set} at {} in {} (*NODE PRINT, NSET={set}, TOTALS=ONLY with RF)",
            step.name,
            path.with_extension("dat").display()
        );
        configuration(anyhow!("--force-from: expected {expected}, found totals of: {found}"))
    })
}

fn is_operating(name: &str) -> bool {
    matches!(name, "pressure_mpa" | "gap_mm")
}

/// The inputs other than pressure and gap, with their mean as the nominal value.
fn parameters(names: &[String], known: &[(String, BTreeMap<String, f64>)]) -> Result<Vec<Parameter>> {
    let further: Vec<&String> = names.iter().filter(|name| !is_operating(name)).collect();
    let most = MAX_INPUTS - PARAMETERS;
    if further.len() > most {
        let error = anyhow!(
            "inputs: expected at most {most} in addition to pressure and gap, found {}",
            further.len()
        );
        return Err(configuration(error));
    }
    let mut parameters = Vec::new();
    for name in further {
        let sum: f64 = known.iter().filter_map(|(_, values)| values.get(name)).sum();
        let nominal = sum / known.len().max(1) as f64;
        parameters.push(Parameter { name: name.clone(), unit: unit(name)?.into(), nominal });
    }
    Ok(parameters)
}

/// Name of a folder's content: of `part/database` the part.
fn subject(out: &Path) -> &Path {
    let parent = out.parent().filter(|parent| parent.file_name().is_some());
    parent.filter(|_| out.file_name().is_some_and(|name| name == "database")).unwrap_or(out)
}

/// A file's name without folder and ending, of letters, digits, - and _.
fn plain(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    stem.chars().map(|c| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' }).collect()
}

fn listed(left_out: &[String]) -> String {
    left_out.iter().map(|reason| format!("\n  left out: {reason}")).collect()
}
