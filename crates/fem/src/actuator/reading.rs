//! Reads and checks `actuator.toml`.

use super::check::diagnostics;
use super::file::Actuator;
use formats::{Diagnostic, FormatError, file};
use std::path::Path;

impl Actuator {
    /// Reads and checks the file.
    ///
    /// # Errors
    /// I/O error, invalid TOML, or all errors in the values.
    pub fn read(path: &Path) -> Result<Self, FormatError> {
        let text = file::read_text(path, file::MAX_TEXT_BYTES)?;
        Self::parse(&text).map_err(|diagnostics| FormatError::Content { path: path.into(), diagnostics })
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
