//! Prints what a command found. A command fills a `serde` struct and hands it to [`print`], which writes it as one line of JSON
//! (`--json`) or as text for people. Both are made of the same fields in the same order, so neither can say what the other does not.
//!
//! In the text, the name of a field becomes its label: `largest_force_n` reads "largest force [N]". A field `title` is the first line and a
//! field `remarks`, a list of sentences, comes last. Scalars form an aligned list, lists of objects a table, objects a section;
//! an object whose fields are all objects of scalars is a table with the names in its first column.

use crate::output;
use serde::de::{Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};
use serde::ser::Serialize;
use std::fmt;

/// Numbers of a list that the text shows; of a longer list it tells the count only.
const SHOWN_NUMBERS: usize = 12;

/// Units as field names end, and as people write them.
const UNITS: &[(&str, &str)] = &[
    ("n_per_mpa", "N/MPa"),
    ("n_per_mm", "N/mm"),
    ("mm", "mm"),
    ("mpa", "MPa"),
    ("kpa", "kPa"),
    ("pa", "Pa"),
    ("n", "N"),
    ("mn", "mN"),
    ("mj", "mJ"),
    ("ml", "ml"),
    ("ns", "ns"),
    ("us", "us"),
    ("ms", "ms"),
    ("s", "s"),
    ("hz", "Hz"),
    ("deg", "deg"),
    ("rad", "rad"),
    ("g", "g"),
    ("kg", "kg"),
    ("bytes", "bytes"),
    ("mb", "MB"),
    ("percent", "%"),
];

/// Prints a report to standard output. A closed pipe is an error, as with `output!`.
pub fn print(report: &impl Serialize, as_json: bool) -> anyhow::Result<()> {
    if as_json {
        return output::json(report);
    }
    let text = text(report)?;
    if !text.is_empty() {
        output!("{text}")?;
    }
    Ok(())
}

/// A report as text for people, without a line break at its end.
pub fn text(report: &impl Serialize) -> serde_json::Result<String> {
    let mut lines = Vec::new();
    match serde_json::from_str(&serde_json::to_string(report)?)? {
        Node::Object(fields) => object_lines(&fields, "", &mut lines),
        Node::List(items) => list_lines(&items, "", &mut lines),
        scalar => lines.push(cell(&scalar)),
    }
    while lines.first().is_some_and(String::is_empty) {
        lines.remove(0);
    }
    Ok(lines.join("\n"))
}

/// A JSON value whose objects keep the order of their fields.
enum Node {
    Null,
    Bool(bool),
    Integer(i128),
    Float(f64),
    Text(String),
    List(Vec<Node>),
    Object(Vec<(String, Node)>),
}

impl<'de> Deserialize<'de> for Node {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(NodeVisitor)
    }
}

struct NodeVisitor;

impl<'de> Visitor<'de> for NodeVisitor {
    type Value = Node;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a JSON value")
    }

    fn visit_unit<E>(self) -> Result<Node, E> {
        Ok(Node::Null)
    }

    fn visit_bool<E>(self, value: bool) -> Result<Node, E> {
        Ok(Node::Bool(value))
    }

    fn visit_i64<E>(self, value: i64) -> Result<Node, E> {
        Ok(Node::Integer(value.into()))
    }

    fn visit_u64<E>(self, value: u64) -> Result<Node, E> {
        Ok(Node::Integer(value.into()))
    }

    fn visit_f64<E>(self, value: f64) -> Result<Node, E> {
        Ok(Node::Float(value))
    }

    fn visit_str<E>(self, value: &str) -> Result<Node, E> {
        Ok(Node::Text(value.to_owned()))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Node, A::Error> {
        let mut list = Vec::new();
        while let Some(item) = items.next_element()? {
            list.push(item);
        }
        Ok(Node::List(list))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut fields: A) -> Result<Node, A::Error> {
        let mut object = Vec::new();
        while let Some(field) = fields.next_entry()? {
            object.push(field);
        }
        Ok(Node::Object(object))
    }
}

fn is_scalar(node: &Node) -> bool {
    match node {
        Node::Object(_) => false,
        Node::List(items) => !items.iter().any(|item| matches!(item, Node::Object(_) | Node::List(_))),
        _ => true,
    }
}

fn object_lines(fields: &[(String, Node)], indent: &str, lines: &mut Vec<String>) {
    let is_line = |name: &str, node: &Node| is_scalar(node) && !matches!(name, "title" | "remarks");
    let width = fields
        .iter()
        .filter(|(name, node)| is_line(name, node))
        .map(|(name, _)| width_of(&label(name)))
        .max();
    let width = width.unwrap_or(0);
    for (_, node) in fields.iter().filter(|(name, _)| name == "title") {
        lines.push(format!("{indent}{}", cell(node)));
    }
    for (name, node) in fields {
        if is_line(name, node) {
            lines.push(format!("{indent}{}  {}", padded(&label(name), width, false), cell(node)));
        }
    }
    let deeper = format!("{indent}  ");
    for (name, node) in fields.iter().filter(|(_, node)| !is_scalar(node)) {
        if indent.is_empty() {
            lines.push(String::new());
        }
        lines.push(format!("{indent}{}", label(name)));
        match node {
            Node::Object(rows) if rows.len() > 1 && rows.iter().all(|(_, row)| is_row(row)) => {
                table_lines(rows.iter().map(|(name, row)| (Some(label(name)), row)), &deeper, lines);
            }
            Node::Object(fields) => object_lines(fields, &deeper, lines),
            Node::List(items) => list_lines(items, &deeper, lines),
            _ => {}
        }
    }
    for (_, node) in fields.iter().filter(|(name, _)| name == "remarks") {
        let Node::List(remarks) = node else { continue };
        if !remarks.is_empty() {
            lines.push(String::new());
        }
        lines.extend(remarks.iter().map(|remark| format!("{indent}{}", cell(remark))));
    }
}

/// A list whose items are objects of scalars is a table; other items follow one another.
fn list_lines(items: &[Node], indent: &str, lines: &mut Vec<String>) {
    if items.is_empty() {
        lines.push(format!("{indent}none"));
    } else if items.iter().all(is_row) {
        table_lines(items.iter().map(|row| (None, row)), indent, lines);
    } else {
        for (index, item) in items.iter().enumerate() {
            if index > 0 && !is_scalar(item) {
                lines.push(String::new());
            }
            match item {
                Node::Object(fields) => object_lines(fields, indent, lines),
                Node::List(items) if !is_scalar(item) => list_lines(items, indent, lines),
                scalar => lines.push(format!("{indent}{}", cell(scalar))),
            }
        }
    }
}

fn is_row(node: &Node) -> bool {
    matches!(node, Node::Object(fields) if fields.iter().all(|(_, node)| is_scalar(node)))
}

/// Rows with their names, if they have any, in the first column.
fn table_lines<'a>(
    rows: impl Iterator<Item = (Option<String>, &'a Node)>,
    indent: &str,
    lines: &mut Vec<String>,
) {
    let fields = |(name, row): (Option<String>, &Node)| {
        let named = name.map(|name| (String::new(), name)).into_iter();
        let Node::Object(fields) = row else { return named.collect() };
        named.chain(fields.iter().map(|(name, node)| (name.clone(), cell(node)))).collect()
    };
    let rows: Vec<Vec<(String, String)>> = rows.map(fields).collect();
    let mut names: Vec<&String> = Vec::new(); // rows may leave out fields
    for (name, _) in rows.iter().flatten() {
        if !names.contains(&name) {
            names.push(name);
        }
    }
    let mut columns = Vec::new();
    for name in names {
        let value = |row: &Vec<(String, String)>| {
            row.iter()
                .find(|(field, _)| field == name)
                .map_or_else(|| "-".to_owned(), |(_, value)| value.clone())
        };
        let values: Vec<String> = rows.iter().map(value).collect();
        let is_number = values.iter().all(|value| value == "-" || value.parse::<f64>().is_ok());
        let heading = label(name);
        let width = values.iter().map(|value| width_of(value)).max().unwrap_or(0).max(width_of(&heading));
        columns.push((heading, values, width, is_number));
    }
    let line = |cells: Vec<String>| format!("{indent}{}", cells.join("  ")).trim_end().to_owned();
    lines.push(line(
        columns.iter().map(|(heading, _, width, right)| padded(heading, *width, *right)).collect(),
    ));
    for row in 0..rows.len() {
        let cells = columns.iter().map(|(_, values, width, right)| padded(&values[row], *width, *right));
        lines.push(line(cells.collect()));
    }
}

fn width_of(text: &str) -> usize {
    text.chars().count()
}

fn padded(text: &str, width: usize, is_right: bool) -> String {
    if is_right { format!("{text:>width$}") } else { format!("{text:<width$}") }
}

/// `largest_force_n` as "largest force [N]".
fn label(name: &str) -> String {
    let with_unit = |(suffix, unit): &(&str, &str)| {
        let words = name.strip_suffix(suffix)?.strip_suffix('_')?;
        Some(format!("{} [{unit}]", words.replace('_', " ")))
    };
    UNITS.iter().find_map(with_unit).unwrap_or_else(|| name.replace('_', " "))
}

fn cell(node: &Node) -> String {
    match node {
        Node::Null => "-".to_owned(),
        Node::Bool(true) => "yes".to_owned(),
        Node::Bool(false) => "no".to_owned(),
        Node::Integer(value) => value.to_string(),
        Node::Float(value) => number(*value),
        Node::Text(text) => text.clone(),
        Node::List(items) if items.is_empty() => "none".to_owned(),
        Node::List(items)
            if items.len() > SHOWN_NUMBERS && matches!(items[0], Node::Float(_) | Node::Integer(_)) =>
        {
            format!("{} values", items.len())
        }
        Node::List(items) => items.iter().map(cell).collect::<Vec<_>>().join(", "),
        Node::Object(_) => String::new(),
    }
}

/// A number with four significant digits.
pub fn number(value: f64) -> String {
    let size = value.abs();
    if size != 0.0 && !(1e-4..1e7).contains(&size) {
        return format!("{value:.3e}");
    }
    let digits_before = if size < 1.0 { 0.0 } else { size.log10().floor() + 1.0 };
    let leading_zeros = if size > 0.0 && size < 1.0 { (-size.log10()).floor() } else { 0.0 };
    let decimals = (4.0 - digits_before + leading_zeros).max(0.0) as usize;
    let text = format!("{value:.decimals$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    text.to_owned()
}

#[cfg(test)]
#[path = "../tests/unit/report.rs"]
mod tests;
