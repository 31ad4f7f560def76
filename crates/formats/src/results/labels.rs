//! The inputs of each imported state: from a table, from the file's name, from the step's time.

use super::run::Run;
use crate::database::SPLITS;
use crate::file::named_in;
use crate::table::{Table, TableRow};
use crate::{Diagnostic, FormatError};
use rom::snapshots::Split;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Why simulations do not become a database.
#[derive(Debug, Error)]
pub enum ImportError {
    /// What was asked for cannot be.
    #[error("{0}")]
    Usage(String),
    /// The files or their inputs do not fit each other.
    #[error("{0}")]
    Refused(String),
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] FormatError),
}

/// Columns of the table that are no inputs.
const WORDS: [&str; 6] = ["file", "step", "case", "regime", "split", "contact_force_n"];

/// Known values of a state in addition to its fields.
#[derive(Clone, Debug, Default)]
pub(super) struct StateLabels {
    pub(super) name: Option<String>,
    /// Cell of the column `regime`.
    pub(super) regime: Option<String>,
    pub(super) split: Option<Split>,
    pub(super) contact_force_n: Option<f64>,
    /// Inputs by name; an empty gap is left out.
    pub(super) values: BTreeMap<String, f64>,
}

/// Where the inputs come from.
pub struct InputSource<'a> {
    /// A table of inputs and its place.
    pub table: Option<(&'a Path, Table)>,
    /// Pattern of the file names.
    pub pattern: Option<&'a str>,
    /// The input that grows with the step's time, and its value at time 1 where no table gives it.
    pub ramp: Option<(&'a str, Option<f64>)>,
}

impl InputSource<'_> {
    /// The steps of a simulation that become states, by position, with their labels.
    pub(super) fn states(
        &self,
        path: &Path,
        run: &Run,
        all: bool,
    ) -> Result<Vec<(usize, StateLabels)>, ImportError> {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let from_name = self.pattern.map(|pattern| matched(pattern, path)).transpose()?;
        let labels = StateLabels { values: from_name.unwrap_or_default(), ..StateLabels::default() };
        let count = run.steps.len();
        let chosen: Vec<usize> = if all { (0..count).collect() } else { (0..count).rev().take(1).collect() };
        let Some((place, table)) = &self.table else {
            return chosen
                .into_iter()
                .map(|step| Ok((step, self.at_time(labels.clone(), run, step, path)?)))
                .collect();
        };
        let file = table.column("file").map_err(|diagnostic| FormatError::one(place, diagnostic))?;
        let mut states: Vec<(usize, StateLabels)> = Vec::new();
        let mut known: BTreeMap<usize, String> = BTreeMap::new();
        let step_column = table.column("step").ok();
        for row in table.rows().filter(|row| is_of(row.text(file), path)) {
            let refused = |reason: String| {
                ImportError::Refused(format!("{}, {}: {reason}", place.display(), row.place()))
            };
            let cell = step_column.map(|column| row.text(column)).filter(|cell| !cell.is_empty());
            let steps = match cell {
                Some(cell) => {
                    let number = cell.parse::<usize>().ok().filter(|number| (1..=count).contains(number));
                    let expected =
                        || refused(format!("expected a step of {name} from 1 to {count}, found {cell}"));
                    vec![number.ok_or_else(expected)? - 1]
                }
                None => chosen.clone(),
            };
            let mut labels = labels.clone();
            read_row(table, &row, &mut labels).map_err(|error| refused(error.to_string()))?;
            for step in steps {
                if let Some(first) = known.insert(step, row.place()) {
                    let step = step + 1;
                    return Err(refused(format!(
                        "expected step {step} of {name} once, found it in {first} as well"
                    )));
                }
                states.push((step, self.at_time(labels.clone(), run, step, path)?));
            }
        }
        if states.is_empty() && count > 0 {
            let reason = format!("expected a row with {name} in column file, found none");
            return Err(FormatError::refused(place, reason).into());
        }
        Ok(states)
    }

    /// Files that the table names, relative to its folder, in its order.
    pub fn files(&self) -> Result<Vec<PathBuf>, FormatError> {
        let Some((place, table)) = &self.table else { return Ok(Vec::new()) };
        let file = table.column("file").map_err(|diagnostic| FormatError::one(place, diagnostic))?;
        let mut files: Vec<PathBuf> = Vec::new();
        for path in table.rows().map(|row| named_in(place, row.text(file))) {
            if !files.contains(&path) {
                files.push(path);
            }
        }
        Ok(files)
    }

    /// Rows of the table whose file is not among `paths`.
    pub(super) fn unused(&self, paths: &[PathBuf]) -> Vec<String> {
        let Some((place, table)) = &self.table else { return Vec::new() };
        let Ok(file) = table.column("file") else { return Vec::new() };
        let is_unused = |row: &TableRow<'_>| !paths.iter().any(|path| is_of(row.text(file), path));
        let what = |row: TableRow<'_>| {
            format!("{}, {}: {} was not given", place.display(), row.place(), row.text(file))
        };
        table.rows().filter(is_unused).map(what).collect()
    }

    fn at_time(
        &self,
        mut labels: StateLabels,
        run: &Run,
        step: usize,
        path: &Path,
    ) -> Result<StateLabels, ImportError> {
        let Some((name, value)) = self.ramp else { return Ok(labels) };
        let Some(time) = run.steps[step].time else {
            return Err(ImportError::Refused(format!(
                "{}, {}: --ramp needs the step's time, which this file does not give; name the step's inputs in a table (--inputs)",
                path.display(),
                run.steps[step].name
            )));
        };
        let full = value.or_else(|| labels.values.get(name).copied()).ok_or_else(|| {
            ImportError::Usage(format!("--ramp {name}: expected its value at time 1, as {name}=VALUE, in --inputs or in --pattern; found none"))
        })?;
        labels.values.insert(name.to_owned(), full * time);
        Ok(labels)
    }
}

/// The words and numbers of a row.
fn read_row(table: &Table, row: &TableRow<'_>, labels: &mut StateLabels) -> Result<(), Diagnostic> {
    row.check_width(false)?;
    for (column, name) in table.header().iter().enumerate() {
        let cell = row.text(column);
        match name.as_str() {
            "file" | "step" => {}
            _ if cell.is_empty() && (name == "gap_mm" || WORDS.contains(&name.as_str())) => {}
            "case" => labels.name = Some(cell.to_owned()),
            "split" => labels.split = Some(row.choice(column, &SPLITS)?),
            "regime" => labels.regime = Some(cell.to_owned()),
            "contact_force_n" => {
                labels.contact_force_n = Some(row.number(column)?);
            }
            _ => {
                let value = row.number(column)?;
                labels.values.insert(name.clone(), value);
            }
        }
    }
    Ok(())
}

/// True if a cell of the column `file` names a file: its path or the end of it, with or without the ending.
fn is_of(cell: &str, path: &Path) -> bool {
    !cell.is_empty() && (path.ends_with(cell) || path.with_extension("").ends_with(cell))
}

/// Reads the numbers of a file name by a pattern such as `run_p{pressure_mpa}_g{gap_mm}_*.frd`; a pattern with folders
/// (`job_{load_n}/results.frd`) is of the end of the path.
fn matched(pattern: &str, path: &Path) -> Result<BTreeMap<String, f64>, ImportError> {
    let parts: Vec<String> = path.iter().map(|part| part.to_string_lossy().into_owned()).collect();
    let depth = pattern.matches('/').count() + 1;
    let name = parts[parts.len().saturating_sub(depth)..].join("/");
    let refused = || {
        ImportError::Usage(format!("--pattern {pattern}: expected a file name of this form, found {name}"))
    };
    let mut literals = pattern.split('{');
    let first = literals.next().unwrap_or_default();
    let mut literals = literals.peekable();
    let (start, end) = literal(&name, first, literals.peek().is_none()).ok_or_else(refused)?;
    let mut rest = name.get(end..).filter(|_| start == 0).ok_or_else(refused)?;
    let mut values = BTreeMap::new();
    while let Some(part) = literals.next() {
        let (key, behind) = part
            .split_once('}')
            .ok_or_else(|| ImportError::Usage(format!("--pattern {pattern}: expected }} behind {{{part}")))?;
        let (start, end) = literal(rest, behind, literals.peek().is_none()).ok_or_else(refused)?;
        let text = &rest[..start];
        rest = &rest[end..];
        let value = text.parse::<f64>().ok().filter(|value| value.is_finite());
        let value = value.ok_or_else(|| {
            ImportError::Usage(format!(
                "--pattern {pattern}: expected a number for {key} in {name}, found {text:?}"
            ))
        })?;
        if values.insert(key.to_owned(), value).is_some() {
            return Err(ImportError::Usage(format!(
                "--pattern {pattern}: expected {{{key}}} once, found it twice"
            )));
        }
    }
    if values.is_empty() { Err(refused()) } else { Ok(values) }
}

/// Beginning and end in `text` of the first place that a literal with `*` for any characters matches; the last one ends the text.
fn literal(text: &str, literal: &str, is_last: bool) -> Option<(usize, usize)> {
    let pieces: Vec<&str> = literal.split('*').collect();
    let (mut start, mut at) = (None, 0);
    for (k, piece) in pieces.iter().enumerate() {
        let from = if is_last && k + 1 == pieces.len() {
            text.len()
                .checked_sub(piece.len())
                .filter(|from| *from >= at && text.is_char_boundary(*from) && text.ends_with(piece))?
        } else {
            at + text[at..].find(piece)?
        };
        start = start.or(Some(from));
        at = from + piece.len();
    }
    Some((start?, at))
}

/// Unit in the suffix of an input's name.
pub(super) fn unit(name: &str) -> Result<&'static str, ImportError> {
    let known = [
        ("mm", "mm"),
        ("m", "m"),
        ("deg", "deg"),
        ("rad", "rad"),
        ("mpa", "MPa"),
        ("kpa", "kPa"),
        ("pa", "Pa"),
        ("gpa", "GPa"),
        ("n", "N"),
        ("nmm", "N mm"),
        ("nm", "N m"),
        ("k", "K"),
        ("c", "C"),
        ("s", "s"),
        ("ms", "ms"),
        ("kg", "kg"),
        ("g", "g"),
        ("v", "V"),
        ("a", "A"),
        ("w", "W"),
        ("1", "1"),
    ];
    let end = name.rsplit_once('_').map(|(_, end)| end.to_ascii_lowercase());
    let found = known.iter().find(|(word, _)| Some(*word) == end.as_deref());
    found.map(|(_, unit)| *unit).ok_or_else(|| {
        let words: Vec<&str> = known.iter().map(|(word, _)| *word).collect();
        ImportError::Refused(format!(
            "input {name}: expected its unit at the end of its name, as load_n (_1 for a plain number), one of {}; found none",
            words.join(", ")
        ))
    })
}
