//! The inputs of each imported state: from a table, from the file's name, from the step's time.

use crate::failure::{configuration, usage};
use crate::files::refusal;
use anyhow::{Context, Result, anyhow, bail};
use formats::database::SPLITS;
use formats::results::Run;
use formats::table::{Row, Table};
use rom::snapshots::Split;
use std::collections::BTreeMap;
use std::path::Path;

/// Columns of the table that are no inputs.
const WORDS: [&str; 6] = ["file", "step", "case", "regime", "split", "contact_force_n"];

/// Known values of a state in addition to its fields.
#[derive(Clone, Debug, Default)]
pub(super) struct Labels {
    pub(super) name: Option<String>,
    /// Cell of the column `regime`.
    pub(super) regime: Option<String>,
    pub(super) split: Option<Split>,
    pub(super) contact_force_n: Option<f64>,
    /// Inputs by name; an empty gap is left out.
    pub(super) values: BTreeMap<String, f64>,
}

/// Where the inputs come from.
pub(super) struct Source<'a> {
    pub(super) table: Option<(&'a Path, Table)>,
    pub(super) pattern: Option<&'a str>,
    /// The input that grows with the step's time, and its value at time 1 where no table gives it.
    pub(super) ramp: Option<(&'a str, Option<f64>)>,
}

impl Source<'_> {
    /// The steps of a simulation that become states, by position, with their labels.
    pub(super) fn states(&self, path: &Path, run: &Run, all: bool) -> Result<Vec<(usize, Labels)>> {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let from_name = self.pattern.map(|pattern| matched(pattern, &name)).transpose()?;
        let labels = Labels { values: from_name.unwrap_or_default(), ..Labels::default() };
        let count = run.steps.len();
        let chosen: Vec<usize> = if all { (0..count).collect() } else { (0..count).rev().take(1).collect() };
        let Some((place, table)) = &self.table else {
            return chosen
                .into_iter()
                .map(|step| Ok((step, self.at_time(labels.clone(), run, step, path)?)))
                .collect();
        };
        let file = table.column("file").map_err(|e| configuration(anyhow!("{}: {e}", place.display())))?;
        let is_mine = |row: &Row<'_>| {
            let cell = row.text(file);
            cell == name
                || Path::new(cell) == path
                || Some(cell) == path.file_stem().and_then(|stem| stem.to_str())
        };
        let mut states = Vec::new();
        for row in table.rows().filter(is_mine) {
            let at = || format!("{}, {}", place.display(), row.place());
            let step = match table
                .column("step")
                .ok()
                .map(|column| row.text(column))
                .filter(|cell| !cell.is_empty())
            {
                Some(cell) => {
                    let number = cell.parse::<usize>().ok().filter(|number| (1..=count).contains(number));
                    vec![
                        number
                            .with_context(|| {
                                format!("{}: expected a step of {name} from 1 to {count}, found {cell}", at())
                            })
                            .map_err(configuration)?
                            - 1,
                    ]
                }
                None => chosen.clone(),
            };
            let mut labels = labels.clone();
            read_row(table, &row, &mut labels).with_context(at).map_err(configuration)?;
            for step in step {
                states.push((step, self.at_time(labels.clone(), run, step, path)?));
            }
        }
        if states.is_empty() && count > 0 {
            let error = anyhow!("{}: expected a row with {name} in column file, found none", place.display());
            return Err(configuration(error));
        }
        Ok(states)
    }

    fn at_time(&self, mut labels: Labels, run: &Run, step: usize, path: &Path) -> Result<Labels> {
        let Some((name, value)) = self.ramp else { return Ok(labels) };
        let Some(time) = run.steps[step].time else {
            return Err(configuration(anyhow!(
                "{}, {}: --ramp needs the step's time, which this file does not give; name the step's inputs in a table (--inputs)",
                path.display(),
                run.steps[step].name
            )));
        };
        let full = value.or_else(|| labels.values.get(name).copied()).ok_or_else(|| {
            usage(format!("--ramp {name}: expected its value at time 1, as {name}=VALUE, in --inputs or in --pattern; found none"))
        })?;
        labels.values.insert(name.to_owned(), full * time);
        Ok(labels)
    }
}

/// The words and numbers of a row.
fn read_row(table: &Table, row: &Row<'_>, labels: &mut Labels) -> Result<()> {
    row.check_width(false).map_err(|e| anyhow!("{e}"))?;
    for (column, name) in table.header().iter().enumerate() {
        let cell = row.text(column);
        match name.as_str() {
            "file" | "step" => {}
            _ if cell.is_empty() && (name == "gap_mm" || WORDS.contains(&name.as_str())) => {}
            "case" => labels.name = Some(cell.to_owned()),
            "split" => labels.split = Some(row.choice(column, &SPLITS).map_err(|e| anyhow!("{e}"))?),
            "regime" => labels.regime = Some(cell.to_owned()),
            "contact_force_n" => {
                labels.contact_force_n = Some(row.number(column).map_err(|e| anyhow!("{e}"))?);
            }
            _ => {
                let value = row.number(column).map_err(|e| anyhow!("{e}"))?;
                labels.values.insert(name.clone(), value);
            }
        }
    }
    Ok(())
}

/// Reads the table.
pub(super) fn table(path: &Path) -> Result<(&Path, Table)> {
    Ok((path, Table::read(path, true).map_err(refusal)?))
}

/// Reads the numbers of a file name by a pattern such as `run_p{pressure_mpa}_g{gap_mm}.frd`.
pub(super) fn matched(pattern: &str, name: &str) -> Result<BTreeMap<String, f64>> {
    let refused = || usage(format!("--pattern {pattern}: expected a file name of this form, found {name}"));
    let mut parts = pattern.split('{');
    let mut rest = name.strip_prefix(parts.next().unwrap_or_default()).ok_or_else(refused)?;
    let mut values = BTreeMap::new();
    for part in parts {
        let (key, literal) = part
            .split_once('}')
            .ok_or_else(|| usage(format!("--pattern {pattern}: expected }} behind {{{part}")))?;
        let end = if literal.is_empty() { Some(rest.len()) } else { rest.find(literal) };
        let (text, after) = rest.split_at(end.ok_or_else(refused)?);
        rest = &after[literal.len()..];
        let value = text.parse::<f64>().ok().filter(|value| value.is_finite());
        let value = value.ok_or_else(|| {
            usage(format!("--pattern {pattern}: expected a number for {key} in {name}, found {text:?}"))
        })?;
        if values.insert(key.to_owned(), value).is_some() {
            bail!(usage(format!("--pattern {pattern}: expected {{{key}}} once, found it twice")));
        }
    }
    if values.is_empty() || !rest.is_empty() { Err(refused()) } else { Ok(values) }
}

/// Unit in the suffix of an input's name.
pub(super) fn unit(name: &str) -> Result<&'static str> {
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
        configuration(anyhow!(
            "input {name}: expected its unit at the end of its name, as load_n (_1 for a plain number), one of {}; found none",
            words.join(", ")
        ))
    })
}
