//! A recording as tables: one CSV file for each topic.

use std::collections::BTreeMap;
use std::fmt;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use serde::de::{Deserialize, Deserializer, MapAccess, Visitor};
use serde_json::Value;
use thiserror::Error;
use wire::KeyExpr;

use crate::{Item, Message, ReadError, ReadItems, RunClock, Stamps};

#[derive(Debug, Error)]
pub enum ExportError {
    #[error(transparent)]
    Read(#[from] ReadError),
    #[error("cannot write {}: {source}", path.display())]
    Write { path: PathBuf, source: io::Error },
}

/// Result of an export.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exported {
    /// Rows of each table.
    pub rows: BTreeMap<PathBuf, u64>,
    /// Messages left out because they are not JSON objects.
    pub left_out: u64,
}

/// Writes every topic that `key` matches into `folder`, named after the topic: `softtwin.finger.state.csv`.
///
/// The columns are the properties of the topic's first message, in its order, after `log_time_ns` and `publish_time_ns`.
/// A list becomes one cell with spaces between, an object one column for each of its properties, an absent number an empty cell.
/// Memory: one chunk of the recording.
///
/// # Errors
/// [`ExportError`]; tables written so far stay.
pub fn export_csv(
    reader: &mut impl ReadItems,
    folder: &Path,
    key: &KeyExpr,
    form: TableForm,
) -> Result<Exported, ExportError> {
    let mut tables: BTreeMap<String, Table> = BTreeMap::new();
    let mut left_out = 0;
    let mut clock = RunClock::new(Stamps::Wall);
    while let Some(item) = reader.next_item()? {
        clock.take(&item);
        let Item::Message(message) = item else { continue };
        let topic = &message.channel.topic;
        if !key.matches(topic) {
            continue;
        }
        let Ok(Properties(properties)) = serde_json::from_slice(&message.data) else {
            left_out += 1;
            continue;
        };
        let cells = cells(&properties);
        let table = match tables.get_mut(topic) {
            Some(table) => table,
            None => {
                tables.entry(topic.clone()).or_insert(Table::create(folder, &message, &properties, form)?)
            }
        };
        table.row(&message, clock.at(message.publish_time_ns), cells)?;
    }
    let mut rows = BTreeMap::new();
    for mut table in tables.into_values() {
        table.out.flush().map_err(|source| ExportError::Write { path: table.path.clone(), source })?;
        rows.insert(table.path, table.rows);
    }
    Ok(Exported { rows, left_out })
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TableForm {
    /// Every property, unchanged.
    Whole,
    /// For programs that use FMI: `time` (s, since the table's first row; it never falls, whatever was done to the clock), then the
    /// properties that are single numbers, NaN if absent.
    Fmi,
}

/// A stamp that lies farther before the last one is of a clock that was set back, ns.
const SET_BACK_NS: i128 = 1_000_000_000;

/// An open table. Its columns are those of the topic's first message.
struct Table {
    path: PathBuf,
    columns: Vec<String>,
    out: csv::Writer<File>,
    rows: u64,
    form: TableForm,
    elapsed: Elapsed,
}

/// Time since the first row, which never falls.
#[derive(Debug, Default)]
struct Elapsed {
    /// Time of the row before, and what is taken from a stamp, ns; `None` before the first row.
    last: Option<(i128, i128)>,
}

impl Elapsed {
    /// Seconds at a stamp. A row that was sent a little before the one before it has its time; where the clock was set back, time goes on
    /// from there.
    fn at(&mut self, stamp_ns: i128) -> f64 {
        let (last_ns, zero_ns) = self.last.unwrap_or((0, stamp_ns));
        let t_ns = stamp_ns - zero_ns;
        let zero_ns = if last_ns - t_ns > SET_BACK_NS { stamp_ns - last_ns } else { zero_ns };
        let t_ns = t_ns.max(last_ns);
        self.last = Some((t_ns, zero_ns));
        t_ns as f64 * 1e-9
    }
}

impl Table {
    fn create(
        folder: &Path,
        message: &Message,
        properties: &[(String, Value)],
        form: TableForm,
    ) -> Result<Self, ExportError> {
        // The topic is read from the file: it must not lead out of the folder.
        let plain = |c: char| if c.is_ascii_alphanumeric() || "_-".contains(c) { c } else { '.' };
        let name: String = message.channel.topic.chars().map(plain).take(200).collect();
        let path = folder.join(format!("{}.csv", name.trim_matches('.')));
        let file = File::create(&path).map_err(|source| ExportError::Write { path: path.clone(), source })?;
        let columns: Vec<String> = match form {
            TableForm::Whole => cells(properties).into_iter().map(|(name, _)| name).collect(),
            TableForm::Fmi => {
                let numbers = properties.iter().filter(|(_, value)| is_number(value));
                numbers.map(|(name, _)| name.clone()).collect()
            }
        };
        let out = csv::Writer::from_writer(file);
        let mut table = Self { path, columns, out, rows: 0, form, elapsed: Elapsed::default() };
        let times: &[&str] = match form {
            TableForm::Whole => &["log_time_ns", "publish_time_ns"],
            TableForm::Fmi => &["time"],
        };
        let head: Vec<String> =
            times.iter().map(|name| (*name).to_owned()).chain(table.columns.clone()).collect();
        table.write(&head)?;
        Ok(table)
    }

    fn row(
        &mut self,
        message: &Message,
        stamp_ns: i128,
        cells: Vec<(String, String)>,
    ) -> Result<(), ExportError> {
        let mut cells: BTreeMap<String, String> = cells.into_iter().collect();
        let mut row = match self.form {
            TableForm::Whole => vec![message.log_time_ns.to_string(), message.publish_time_ns.to_string()],
            TableForm::Fmi => vec![self.elapsed.at(stamp_ns).to_string()],
        };
        for column in &self.columns {
            let cell = cells.remove(column).unwrap_or_default();
            let is_absent = self.form == TableForm::Fmi && cell.is_empty();
            row.push(if is_absent { "NaN".into() } else { cell });
        }
        self.rows += 1;
        self.write(&row)
    }

    fn write(&mut self, row: &[String]) -> Result<(), ExportError> {
        let written = self.out.write_record(row);
        written.map_err(|error| ExportError::Write { path: self.path.clone(), source: error.into() })
    }
}

/// An absent number is null in JSON, an infinite one a string.
fn is_number(value: &Value) -> bool {
    value.is_number() || value.is_null() || matches!(value.as_str(), Some("Infinity" | "-Infinity"))
}

fn cells(properties: &[(String, Value)]) -> Vec<(String, String)> {
    let mut cells = Vec::new();
    for (name, value) in properties {
        match value {
            Value::Object(inner) => {
                cells.extend(inner.iter().map(|(key, value)| (format!("{name}.{key}"), cell(value))));
            }
            value => cells.push((name.clone(), cell(value))),
        }
    }
    cells
}

fn cell(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::String(text) => text.clone(),
        // An absent value keeps its place in a list.
        Value::Array(items) => {
            let item = |item: &Value| if item.is_null() { "NaN".to_owned() } else { cell(item) };
            items.iter().map(item).collect::<Vec<_>>().join(" ")
        }
        other => other.to_string(),
    }
}

/// A JSON object with its properties in their order.
struct Properties(Vec<(String, Value)>);

impl<'de> Deserialize<'de> for Properties {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        struct InOrder;
        impl<'de> Visitor<'de> for InOrder {
            type Value = Properties;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Properties, A::Error> {
                let mut properties = Vec::new();
                while let Some(property) = map.next_entry()? {
                    properties.push(property);
                }
                Ok(Properties(properties))
            }
        }
        from.deserialize_map(InOrder)
    }
}
