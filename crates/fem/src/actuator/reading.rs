//! Reads and checks `actuator.toml`.

use super::check::diagnostics;
use super::file::Actuator;
use crate::material::MaterialFile;
use formats::{Diagnostic, FormatError, file};
use std::path::{Path, PathBuf};
use toml::{Table, Value};

impl Actuator {
    /// Reads and checks the file, and the material file that it names.
    ///
    /// # Errors
    /// I/O error, invalid TOML, or all errors in the values.
    pub fn read(path: &Path) -> Result<Self, FormatError> {
        let mut text = file::read_text(path, file::MAX_TEXT_BYTES)?;
        let content = |diagnostics| FormatError::Content { path: path.into(), diagnostics };
        if let Some(material) = Self::material_path(path, &text).map_err(|found| content(vec![found]))? {
            let elastomer = MaterialFile::read(&material)?.elastomer;
            text = with_elastomer(&text, &elastomer).map_err(|found| content(vec![found]))?;
        }
        Self::parse(&text).map_err(content)
    }

    /// The material file that an actuator file names, `None` if it has the constants itself.
    ///
    /// # Errors
    /// I/O error, invalid content.
    pub fn material(path: &Path) -> Result<Option<(PathBuf, MaterialFile)>, FormatError> {
        let text = file::read_text(path, file::MAX_TEXT_BYTES)?;
        let named = Self::material_path(path, &text).map_err(|found| FormatError::one(path, found))?;
        named.map(|path| MaterialFile::read(&path).map(|material| (path, material))).transpose()
    }

    /// `elastomer.file`, relative to the actuator's folder; invalid TOML names none.
    fn material_path(path: &Path, text: &str) -> Result<Option<PathBuf>, Diagnostic> {
        let Ok(table) = text.parse::<Table>() else { return Ok(None) };
        let Some(elastomer) = table.get("elastomer").and_then(Value::as_table) else { return Ok(None) };
        match (elastomer.get("file"), elastomer.len()) {
            (None, _) => Ok(None),
            (Some(Value::String(file)), 1) => Ok(Some(file::named_in(path, file))),
            (Some(Value::String(_)), _) => {
                let others: Vec<&str> =
                    elastomer.keys().map(String::as_str).filter(|key| *key != "file").collect();
                Err(Diagnostic::new(
                    "elastomer",
                    "file alone, which has all constants",
                    format!("{} as well", others.join(", ")),
                ))
            }
            (Some(other), _) => Err(Diagnostic::new("elastomer.file", "the name of a material file", other)),
        }
    }

    /// [`Actuator::read`] from memory.
    ///
    /// # Errors
    /// All errors; never empty.
    pub fn parse(text: &str) -> Result<Self, Vec<Diagnostic>> {
        let actuator: Self = toml::from_str(text).map_err(|error| {
            let expected = "the keys of models/pneunet/actuator.toml";
            vec![Diagnostic::new("content", expected, error.to_string().trim_end())]
        })?;
        let diagnostics = diagnostics(&actuator);
        if diagnostics.is_empty() { Ok(actuator) } else { Err(diagnostics) }
    }
}

/// The file with another elastomer.
fn with_elastomer(text: &str, elastomer: &crate::material::Elastomer) -> Result<String, Diagnostic> {
    let wrong = |error: &dyn std::fmt::Display| Diagnostic::new("elastomer", "an elastomer", error);
    let mut table: Table = text.parse().map_err(|error: toml::de::Error| wrong(&error))?;
    table.insert("elastomer".into(), Value::try_from(elastomer).map_err(|error| wrong(&error))?);
    toml::to_string(&table).map_err(|error| wrong(&error))
}
