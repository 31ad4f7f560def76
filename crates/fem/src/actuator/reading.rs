//! Reads and checks `actuator.toml`.

use super::file::Actuator;
use crate::material::MaterialFile;
use formats::{Diagnostic, FormatError, file};
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// Material file and the table that names it: `elastomer`, or a volume's among `materials`.
type Named = (Option<String>, PathBuf);

impl Actuator {
    /// Reads and checks the file, and the material files that it names.
    ///
    /// # Errors
    /// I/O error, invalid TOML, or all errors in the values.
    pub fn read(path: &Path) -> Result<Self, FormatError> {
        let mut text = file::read_text(path, file::MAX_TEXT_BYTES)?;
        let content = |diagnostics| FormatError::Content { path: path.into(), diagnostics };
        for (volume, material) in material_paths(path, &text).map_err(|found| content(vec![found]))? {
            let elastomer = MaterialFile::read(&material)?.elastomer;
            text =
                with_elastomer(&text, volume.as_deref(), &elastomer).map_err(|found| content(vec![found]))?;
        }
        Self::parse(&text).map_err(content)
    }

    /// The material file of the elastomer, `None` if the actuator file has the constants itself.
    ///
    /// # Errors
    /// I/O error, invalid content.
    pub fn material(path: &Path) -> Result<Option<(PathBuf, MaterialFile)>, FormatError> {
        let text = file::read_text(path, file::MAX_TEXT_BYTES)?;
        let named = material_paths(path, &text).map_err(|found| FormatError::one(path, found))?;
        let elastomer_path = named.into_iter().find_map(|(volume, path)| volume.is_none().then_some(path));
        elastomer_path.map(|path| MaterialFile::read(&path).map(|material| (path, material))).transpose()
    }

    /// [`Actuator::read`] from memory.
    ///
    /// # Errors
    /// All errors; never empty.
    pub fn parse(text: &str) -> Result<Self, Vec<Diagnostic>> {
        let mut actuator: Self = toml::from_str(text).map_err(|error| {
            let expected = "the keys of models/pneunet/actuator.toml";
            vec![Diagnostic::new("content", expected, error.to_string().trim_end())]
        })?;
        // 0 leaves a part out.
        actuator.slots = actuator.slots.filter(|slots| slots.width_mm != 0.0);
        actuator.channels = actuator.channels.filter(|channels| channels.width_mm != 0.0);
        actuator.sheet = actuator.sheet.filter(|sheet| sheet.thickness_mm != 0.0);
        let diagnostics = actuator.diagnostics();
        if diagnostics.is_empty() { Ok(actuator) } else { Err(diagnostics) }
    }
}

/// `file` of `elastomer` and of each material, relative to the actuator's folder; invalid TOML names none.
fn material_paths(path: &Path, text: &str) -> Result<Vec<Named>, Diagnostic> {
    let Ok(table) = text.parse::<Table>() else { return Ok(Vec::new()) };
    let elastomer = table.get("elastomer").map(|value| (None, value));
    let volumes = table.get("materials").and_then(Value::as_table).into_iter().flatten();
    let all = elastomer.into_iter().chain(volumes.map(|(name, value)| (Some(name.clone()), value)));
    let mut named = Vec::new();
    for (volume, value) in all {
        let Some(elastomer) = value.as_table() else { continue };
        let key = volume.as_ref().map_or("elastomer".to_owned(), |name| format!("materials.{name}"));
        match (elastomer.get("file"), elastomer.len()) {
            (None, _) => {}
            (Some(Value::String(file)), 1) => {
                named.push((volume, file::named_in(path, file)));
            }
            (Some(Value::String(_)), _) => {
                let others: Vec<&str> =
                    elastomer.keys().map(String::as_str).filter(|key| *key != "file").collect();
                let found = format!("{} as well", others.join(", "));
                return Err(Diagnostic::new(key, "file alone, which has all constants", found));
            }
            (Some(other), _) => {
                return Err(Diagnostic::new(format!("{key}.file"), "the name of a material file", other));
            }
        }
    }
    Ok(named)
}

/// The file with another elastomer, or another material of a volume.
pub(super) fn with_elastomer(
    text: &str,
    volume: Option<&str>,
    elastomer: &crate::material::Elastomer,
) -> Result<String, Diagnostic> {
    let wrong = |error: &dyn std::fmt::Display| Diagnostic::new("elastomer", "an elastomer", error);
    let mut table: Table = text.parse().map_err(|error: toml::de::Error| wrong(&error))?;
    let value = Value::try_from(elastomer).map_err(|error| wrong(&error))?;
    let materials = table.get_mut("materials").and_then(Value::as_table_mut);
    match (volume, materials) {
        (Some(name), Some(materials)) => materials.insert(name.into(), value),
        _ => table.insert("elastomer".into(), value),
    };
    toml::to_string(&table).map_err(|error| wrong(&error))
}
