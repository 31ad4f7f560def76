//! Commands that make files of other formats readable, by the ending of the name.

use crate::error::{Diagnostic, FormatError};
use crate::file::quoted;
use std::path::Path;

/// Endings that `softtwin-convert` of the Python client reads.
const CONVERTED: [&str; 11] = ["xdmf", "xmf", "xplt", "cdb", "rpt", "vtk", "med", "e", "exo", "bdf", "nas"];
/// Endings with another remedy.
const ELSEWHERE: [(&str, &str); 5] = [
    ("h5", "softtwin-convert on the .xdmf that lists its data sets"),
    ("case", "open the EnSight case in ParaView and save its data as .pvd"),
    ("odb", "write mesh (.inp) and fields (.csv) with Abaqus' Python: docs/import.md"),
    ("rst", "write mesh (CDWRITE, .cdb) and nodal results (PRNSOL, .txt): docs/import.md"),
    ("dat", "name the .frd of the same job; its .dat is read with it"),
];

/// Error for an ending that no reader accepts, with the command that converts the file to `target`.
pub(crate) fn error(path: &Path, expected: &str, target: &str) -> FormatError {
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
    let found = ending.as_ref().map_or_else(|| "no ending".into(), |ending| format!(".{ending}"));
    let ending = ending.unwrap_or_default();
    let remedy = if CONVERTED.contains(&ending.as_str()) {
        let out = path.with_extension(target);
        Some(format!("softtwin-convert {} --out {}", quoted(path), quoted(&out)))
    } else {
        ELSEWHERE.iter().find(|(known, _)| *known == ending).map(|(_, remedy)| (*remedy).to_owned())
    };
    let expected =
        remedy.map_or_else(|| expected.into(), |remedy| format!("{expected}; convert it: {remedy}"));
    FormatError::one(path, Diagnostic::new("file name", expected, found))
}
