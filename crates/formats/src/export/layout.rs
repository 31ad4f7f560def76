//! What a format writes before, for and after the states.

use super::series::Moment;
use std::io::{self, Write};

/// One format; the file is opened and closed by the writer.
pub(crate) trait Layout {
    /// What stands before the first state.
    fn begin(&mut self, out: &mut dyn Write) -> io::Result<()>;

    /// One state; `index` counts from 0.
    fn state(&mut self, out: &mut dyn Write, index: usize, moment: &Moment) -> io::Result<()>;

    /// What stands behind the last state.
    fn end(&mut self, _out: &mut dyn Write) -> io::Result<()> {
        Ok(())
    }
}

/// Numbers in lines of so many, each with a space behind it.
pub(crate) fn lines(out: &mut dyn Write, values: &[impl std::fmt::Display], a_line: usize) -> io::Result<()> {
    for line in values.chunks(a_line) {
        line.iter().try_for_each(|value| write!(out, "{value} "))?;
        writeln!(out)?;
    }
    Ok(())
}
