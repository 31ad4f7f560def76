//! All states as one table: one row per node and state.

use super::label::Label;
use super::series::{Layout, Moment, Series};
use crate::table::TableWriter;
use std::fmt::Display;
use std::io::{self, Write};

pub(crate) struct Csv<'a>(pub(crate) Series<'a>);

/// Names of the columns that are constant within a state.
pub(super) fn heading(label: &Label) -> impl Iterator<Item = String> {
    let name = Some("case".to_owned()).filter(|_| !label.name.is_empty());
    label.numbers.iter().map(|(name, _)| name.clone()).chain(name)
}

/// Values of these columns; empty if not finite.
pub(super) fn cells(label: &Label) -> Vec<String> {
    let number = |value: f64| if value.is_finite() { value.to_string() } else { String::new() };
    let name = Some(label.name.clone()).filter(|name| !name.is_empty());
    label.numbers.iter().map(|(_, value)| number(*value)).chain(name).collect()
}

impl Layout for Csv<'_> {
    /// Writes nothing: the heading needs the names in the first state.
    fn begin(&mut self, _: &mut dyn Write) -> io::Result<()> {
        Ok(())
    }

    fn state(&mut self, out: &mut dyn Write, index: usize, moment: &Moment) -> io::Result<()> {
        let mut table = TableWriter::new(out);
        if index == 0 {
            let first = ["time", "node"].map(str::to_owned);
            table.row(first.into_iter().chain(self.0.columns()).chain(heading(&moment.label)))?;
        }
        let last = cells(&moment.label);
        for node in 0..self.0.nodes {
            let values: Vec<f32> = self.0.at_node(&moment.values, node).collect();
            let first: [&dyn Display; 2] = [&moment.time, &node];
            let values = values.iter().map(|value| value as &dyn Display);
            table.row(first.into_iter().chain(values).chain(last.iter().map(|cell| cell as &dyn Display)))?;
        }
        table.finish().map(drop)
    }
}
