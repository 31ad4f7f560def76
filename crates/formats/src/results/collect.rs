//! Finished simulations, with the inputs of each, as one database.

use super::assemble::{Assembly, Wanted};
use super::labels::{ImportError, InputSource, StateLabels, unit};
use super::run::{Run, Step};
use super::{frd, nodal, stacks, vtk};
use crate::cells::Block;
use crate::database::ANY_REGIME;
use crate::file::unreadable;
use crate::{Diagnostic, FormatError};
use rom::inputs::{MAX_INPUTS, PARAMETERS, Parameter};
use rom::snapshots::{Case, Database, RegimeKind, Split};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Reads one finished simulation, by the ending of its name.
///
/// # Errors
/// An unknown ending, with the command that converts the file; errors of the format's reader.
pub fn read(path: &Path) -> Result<Run, FormatError> {
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
    match ending.as_deref() {
        _ if path.is_dir() => stacks::read(path),
        Some("frd") => frd::read(path),
        Some("vtu") => vtk::read(path),
        Some("pvd") => vtk::read_series(path),
        Some("inp") => nodal::read(path),
        Some("npz") => stacks::read_archive(path),
        _ => Err(unreadable(path, "results as .frd, .vtu, .pvd, .inp, .npz or a folder of .npy", "npz")),
    }
}

/// How simulations become states.
pub struct ImportOptions<'a> {
    /// Units and names of the fields.
    pub wanted: Wanted,
    /// True if all steps become states, not the last one alone.
    pub all_steps: bool,
    /// Node set whose total force is the contact force of states that have a gap and no force in the table.
    pub force_from: Option<&'a str>,
    /// Every so-manieth state inside the ranges of the inputs is for testing.
    pub test_every: Option<usize>,
    /// Name of what was simulated.
    pub name: String,
}

/// States of finished simulations.
pub struct ImportedStates {
    /// The states.
    pub database: Database,
    /// Cells of the mesh.
    pub blocks: Vec<Block>,
    /// Nodes of the mesh.
    pub nodes: usize,
    /// True if the undeformed shape differs between simulations.
    pub shape_varies: bool,
    /// What did not become a state or a field, with the reason.
    pub left_out: Vec<String>,
}

/// Reads all simulations, one file or folder each.
///
/// # Errors
/// Errors in a file, a step or an input, by name.
pub fn collect(
    paths: &[PathBuf],
    source: &InputSource<'_>,
    options: ImportOptions<'_>,
) -> Result<ImportedStates, ImportError> {
    let ImportOptions { wanted, all_steps, force_from, test_every, name } = options;
    let mut states = States {
        assembly: Assembly::new(wanted),
        known: Vec::new(),
        has_split: Vec::new(),
        left_out: Vec::new(),
        names: Vec::new(),
    };
    for path in paths {
        let namesakes = paths.iter().filter(|other| other.file_stem() == path.file_stem()).count();
        let folder = path.parent().filter(|_| namesakes > 1).and_then(Path::file_name);
        let name = folder.map_or(plain_name(path), |folder| {
            format!("{}-{}", plain_name(Path::new(folder)), plain_name(path))
        });
        states.simulation(path, &name, source, all_steps, force_from)?;
    }
    states.left_out.extend(source.unused(paths));
    let (nodes, shape_varies) = (states.assembly.nodes(), states.assembly.shape_varies());
    let left_out = [states.assembly.parts_left_out(), &states.left_out].concat();
    let parameters = parameters(&states.names, &states.known)?;
    let (mut database, blocks) = states.assembly.finish(name, parameters).map_err(|error| {
        let left_out: String = left_out.iter().map(|reason| format!("\n  left out: {reason}")).collect();
        ImportError::Refused(format!("{error}{left_out}"))
    })?;
    if let Some(every) = test_every {
        hold_back(&mut database.cases, &states.known, &states.has_split, every);
    }
    Ok(ImportedStates { database, blocks, nodes, shape_varies, left_out })
}

/// Range of each input over all states; of the gap over those that have one.
pub fn input_ranges(database: &Database) -> Vec<(String, [f64; 2])> {
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
    fn simulation(
        &mut self,
        path: &Path,
        name: &str,
        source: &InputSource<'_>,
        all_steps: bool,
        force_from: Option<&str>,
    ) -> Result<(), ImportError> {
        let run = read(path)?;
        self.left_out.extend(run.left_out.iter().map(|reason| format!("{}, {reason}", path.display())));
        if run.steps.is_empty() {
            self.left_out.push(format!("{}: no step that is a state", path.display()));
        }
        let states = source.states(path, &run, all_steps)?;
        let several = states.len() > 1;
        for (index, mut labels) in states {
            let step = &run.steps[index];
            let place = format!("{}, {}", path.display(), step.name);
            let wanted = labels.contact_force_n.is_none() && labels.values.contains_key("gap_mm");
            if let Some(set) = force_from.filter(|_| wanted) {
                labels.contact_force_n = Some(total_force(set, &run, step, path)?);
            }
            let suffix = if several { format!("-{}", index + 1) } else { String::new() };
            let name = labels.name.clone().unwrap_or_else(|| format!("{name}{suffix}"));
            let inputs = self.inputs(&place, &labels)?;
            let case = case(&place, name, &labels)?;
            match self.assembly.add(path, &run, step, case)? {
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
    fn inputs(&mut self, place: &str, labels: &StateLabels) -> Result<BTreeMap<String, f64>, ImportError> {
        let found: Vec<&String> = labels.values.keys().filter(|name| *name != "gap_mm").collect();
        if self.names.is_empty() {
            self.names = found.iter().map(|name| (*name).clone()).collect();
        }
        if self.names.is_empty() || found != self.names.iter().collect::<Vec<_>>() {
            let expected = self.names.join(", ");
            return Err(ImportError::Refused(format!(
                "{place}: expected the inputs {expected} as for the first state, found {found:?}"
            )));
        }
        if let Some((twin, _)) = self.known.iter().find(|(_, other)| *other == labels.values) {
            return Err(ImportError::Refused(format!(
                "{place}: expected inputs that no other state has, found those of {twin} ({:?}); --ramp or a column step \
                 tell steps apart",
                labels.values
            )));
        }
        Ok(labels.values.clone())
    }
}

/// A state; for training unless the table has another split.
fn case(place: &str, name: String, labels: &StateLabels) -> Result<Case, ImportError> {
    let gap_mm = labels.values.get("gap_mm").copied();
    let regime = regime(place, labels, gap_mm.is_some())?;
    if regime == RegimeKind::Contact && (gap_mm.is_none() || labels.contact_force_n.is_none()) {
        return Err(ImportError::Refused(format!(
            "{place}: expected gap_mm and contact_force_n in the table for a state in contact (force 0 where nothing \
                 touches), found one without"
        )));
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
fn regime(place: &str, labels: &StateLabels, has_gap: bool) -> Result<RegimeKind, ImportError> {
    match labels.regime.as_deref() {
        Some("free") => Ok(RegimeKind::Free),
        Some("contact") => Ok(RegimeKind::Contact),
        None => Ok(if has_gap { RegimeKind::Contact } else { RegimeKind::Free }),
        Some(found) => {
            let error = Diagnostic::new(format!("{place}, regime"), ANY_REGIME, format!("`{found}`"));
            Err(ImportError::Refused(error.to_string()))
        }
    }
}

/// The contact force of a step, from what the solver printed beside its results.
fn total_force(set: &str, run: &Run, step: &Step, path: &Path) -> Result<f64, ImportError> {
    run.total_force(set, step).map_err(|sets| {
        let found = if sets.is_empty() { "none".to_owned() } else { sets.join(", ") };
        let expected = format!(
            "the total force of {set} at {} in {} (*NODE PRINT, NSET={set}, TOTALS=ONLY with RF)",
            step.name,
            path.with_extension("dat").display()
        );
        ImportError::Refused(format!("--force-from: expected {expected}, found totals of: {found}"))
    })
}

fn is_operating(name: &str) -> bool {
    matches!(name, "pressure_mpa" | "gap_mm")
}

/// The inputs other than pressure and gap, with their mean as the nominal value.
fn parameters(
    names: &[String],
    known: &[(String, BTreeMap<String, f64>)],
) -> Result<Vec<Parameter>, ImportError> {
    let further: Vec<&String> = names.iter().filter(|name| !is_operating(name)).collect();
    let most = MAX_INPUTS - PARAMETERS;
    if further.len() > most {
        return Err(ImportError::Refused(format!(
            "inputs: expected at most {most} in addition to pressure and gap, found {}",
            further.len()
        )));
    }
    let mut parameters = Vec::new();
    for name in further {
        let sum: f64 = known.iter().filter_map(|(_, values)| values.get(name)).sum();
        let nominal = sum / known.len().max(1) as f64;
        parameters.push(Parameter { name: name.clone(), unit: unit(name)?.into(), nominal });
    }
    Ok(parameters)
}

/// A file's name without folder and ending, of letters, digits, - and _.
pub fn plain_name(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    stem.chars().map(|c| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' }).collect()
}
