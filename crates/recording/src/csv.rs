//! A recording as tables: one CSV file for each topic.

use std::collections::BTreeMap;
use std::fmt;
use std::fs::File;
use std::io::{self, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use serde::de::{Deserialize, Deserializer, MapAccess, Visitor};
use serde_json::Value;
use thiserror::Error;
use wire::KeyExpr;

use crate::{Ending, Item, Message, ReadError, Reader};

/// Why an export ended early.
#[derive(Debug, Error)]
pub enum ExportError {
    /// The recording.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// A table.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The table.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

/// What was exported.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exported {
    /// Rows of each table.
    pub rows: BTreeMap<PathBuf, u64>,
    /// Messages that are no JSON objects and were left out.
    pub left_out: u64,
    /// How the recording ended.
    pub ending: Ending,
}

/// A table on its way: its columns are those of the topic's first message.
struct Table {
    path: PathBuf,
    columns: Vec<String>,
    out: BufWriter<File>,
    rows: u64,
}

/// Writes every topic that `key` matches into `folder`, named after the topic: `softtwin.finger.state.csv`.
///
/// The columns are the properties of the topic's first message, in its order, after `log_time_ns` and `publish_time_ns`.
/// A list becomes one cell with spaces between, an object one column for each of its properties. Memory: one chunk of the
/// recording.
///
/// # Errors
/// [`ExportError`]; tables written so far stay.
pub fn export_csv<R: Read>(
    mut reader: Reader<R>,
    folder: &Path,
    key: &KeyExpr,
) -> Result<Exported, ExportError> {
    let mut tables: BTreeMap<String, Table> = BTreeMap::new();
    let mut left_out = 0;
    while let Some(item) = reader.next_item()? {
        let Item::Message(message) = item else { continue };
        let topic = message.channel.topic.clone();
        if !key.matches(&topic) {
            continue;
        }
        let Ok(Properties(properties)) = serde_json::from_slice(&message.data) else {
            left_out += 1;
            continue;
        };
        let cells = cells(&properties);
        let table = match tables.remove(&topic) {
            Some(table) => Ok(table),
            None => Table::create(folder, &topic, &cells),
        };
        let mut table = table.map_err(|(path, source)| ExportError::Write { path, source })?;
        table
            .row(&message, cells)
            .map_err(|source| ExportError::Write { path: table.path.clone(), source })?;
        tables.insert(topic, table);
    }
    let mut rows = BTreeMap::new();
    for mut table in tables.into_values() {
        table.out.flush().map_err(|source| ExportError::Write { path: table.path.clone(), source })?;
        rows.insert(table.path, table.rows);
    }
    Ok(Exported { rows, left_out, ending: reader.ending().cloned().unwrap_or(Ending::Complete) })
}

impl Table {
    fn create(folder: &Path, topic: &str, cells: &[(String, String)]) -> Result<Self, (PathBuf, io::Error)> {
        // A topic comes out of the file: nothing in it may lead out of the folder.
        let plain = |c: char| if c.is_ascii_alphanumeric() || "_-".contains(c) { c } else { '.' };
        let name: String = topic.chars().map(plain).take(200).collect();
        let path = folder.join(format!("{}.csv", name.trim_matches('.')));
        let columns: Vec<String> = cells.iter().map(|(name, _)| name.clone()).collect();
        let create = || {
            let mut out = BufWriter::new(File::create(&path)?);
            let head =
                ["log_time_ns", "publish_time_ns"].into_iter().chain(columns.iter().map(String::as_str));
            writeln!(out, "{}", head.map(quote).collect::<Vec<_>>().join(","))?;
            Ok(out)
        };
        match create() {
            Ok(out) => Ok(Self { path, columns, out, rows: 0 }),
            Err(error) => Err((path, error)),
        }
    }

    fn row(&mut self, message: &Message, cells: Vec<(String, String)>) -> io::Result<()> {
        let mut cells: BTreeMap<String, String> = cells.into_iter().collect();
        write!(self.out, "{},{}", message.log_time_ns, message.publish_time_ns)?;
        for column in &self.columns {
            write!(self.out, ",{}", quote(&cells.remove(column).unwrap_or_default()))?;
        }
        self.rows += 1;
        writeln!(self.out)
    }
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
        Value::Array(items) => items.iter().map(cell).collect::<Vec<_>>().join(" "),
        other => other.to_string(),
    }
}

/// Quotes as RFC 4180 asks, only where it must be.
fn quote(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
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
