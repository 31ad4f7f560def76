//! All states as one table: a row for each node of each state.

use super::layout::Layout;
use super::series::{Moment, Series};
use crate::table::TableWriter;
use std::fmt::Display;
use std::io::{self, Write};

pub(crate) struct Csv<'a>(pub(crate) Series<'a>);

impl Layout for Csv<'_> {
    fn begin(&mut self, out: &mut dyn Write) -> io::Result<()> {
        let first = ["time", "node"].map(str::to_owned);
        let mut table = TableWriter::new(out);
        table.row(first.into_iter().chain(self.0.columns()))?;
        table.finish().map(drop)
    }

    fn state(&mut self, out: &mut dyn Write, _: usize, moment: &Moment) -> io::Result<()> {
        let mut table = TableWriter::new(out);
        for node in 0..self.0.nodes {
            let values: Vec<f32> = self.0.at_node(&moment.values, node).collect();
            let first: [&dyn Display; 2] = [&moment.time, &node];
            table.row(first.into_iter().chain(values.iter().map(|value| value as &dyn Display)))?;
        }
        table.finish().map(drop)
    }
}
