//! All states as one NumPy array: f32, states x nodes x fields, as `snapshots.npy` of a database.

use super::series::{Layout, Moment, Series};
use crate::npy;
use std::io::{self, Write};

pub(crate) struct Npy<'a>(pub(crate) Series<'a>);

impl Layout for Npy<'_> {
    fn begin(&mut self, out: &mut dyn Write) -> io::Result<()> {
        npy::write_f32_to(out, &[self.0.count, self.0.nodes, self.0.fields.len()], &[])
    }

    fn state(&mut self, out: &mut dyn Write, _: usize, moment: &Moment) -> io::Result<()> {
        let values = (0..self.0.nodes).flat_map(|node| self.0.at_node(&moment.values, node));
        let bytes: Vec<u8> = values.flat_map(f32::to_le_bytes).collect();
        out.write_all(&bytes)
    }
}
