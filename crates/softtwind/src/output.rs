//! Results on standard output. Unlike `println!` a closed pipe (`| head`) is an error the caller passes on with `?`;
//! the program then ends with code 0.

use std::fmt::Arguments;
use std::io::{self, Write};

/// Writes one line to standard output; evaluates to `io::Result<()>`.
#[macro_export]
macro_rules! output {
    ($($part:tt)*) => { $crate::output::line(format_args!($($part)*)) };
}

/// One line to standard output.
pub fn line(text: Arguments<'_>) -> io::Result<()> {
    let mut out = io::stdout().lock();
    out.write_fmt(text)?;
    out.write_all(b"\n")
}

/// One JSON value as one line on standard output.
pub fn json(value: &impl serde::Serialize) -> anyhow::Result<()> {
    line(format_args!("{}", serde_json::to_string(value)?))?;
    Ok(())
}
