//! Total forces that CalculiX prints into `job.dat`, next to `job.frd`, for `*NODE PRINT, NSET=PLATE, TOTALS=ONLY` with `RF`.

use super::run::Total;
use crate::error::{Diagnostic, FormatError};
use crate::file;
use std::path::Path;

/// Words before the name of the set, and between it and the time.
const KEYS: [&str; 2] = ["total force (fx,fy,fz) for set ", " and time "];

/// Reads the `.dat` of a `.frd`; empty if there is none.
pub(super) fn beside(frd: &Path) -> Result<Vec<Total>, FormatError> {
    let path = frd.with_extension("dat");
    if !path.is_file() {
        return Ok(Vec::new());
    }
    let bytes = file::read_bytes(&path, file::MAX_DATA_BYTES)?;
    parse(&String::from_utf8_lossy(&bytes))
        .map_err(|diagnostics| FormatError::Content { path, diagnostics: vec![diagnostics] })
}

/// Reads the content of a file; other output is ignored. The file of a killed job may be cut short.
///
/// # Errors
/// A total without a time, or without its three numbers.
pub fn parse(text: &str) -> Result<Vec<Total>, Diagnostic> {
    let mut totals = Vec::new();
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    while let Some((at, line)) = lines.next() {
        let Some(rest) = line.trim().strip_prefix(KEYS[0]) else { continue };
        let place = format!("line {}", at + 1);
        let known = rest.rsplit_once(KEYS[1]).and_then(|(set, time)| Some((set.trim(), finite(time)?)));
        let Some((set, time)) = known else {
            return Err(Diagnostic::new(place, "a set and a time", rest));
        };
        let Some((at, numbers)) = lines.next() else { break };
        let force: Option<Vec<f64>> = numbers.split_ascii_whitespace().map(finite).collect();
        let Some(force) = force.and_then(|force| <[f64; 3]>::try_from(force).ok()) else {
            return Err(Diagnostic::new(
                format!("line {}", at + 1),
                "three numbers, the force along x, y and z",
                numbers,
            ));
        };
        totals.push(Total { set: set.to_owned(), time, force });
    }
    Ok(totals)
}

fn finite(word: &str) -> Option<f64> {
    word.trim().parse().ok().filter(|value: &f64| value.is_finite())
}
