//! Material files: the elastomer of an actuator with the tests behind it.

use super::Elastomer;
use super::specimen::FittedSpecimens;
use formats::{Diagnostic, FormatError, file};
use serde::Deserialize;
use std::path::Path;

/// Content of a material file; `elastomer.file` of `actuator.toml` names it.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaterialFile {
    /// Layout version, 1.
    pub layout: u32,
    /// The elastomer.
    pub elastomer: Elastomer,
    /// The fit.
    pub fit: Option<FitRecord>,
}

/// Fit behind the constants.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FitRecord {
    /// RMS error over all tests, % of the largest stress.
    pub rms_percent: f64,
    /// RMS error at strains of 2 to 30 %, % of the stress there.
    pub working_strains_percent: Option<f64>,
    /// The tests.
    pub tests: Vec<TestRecord>,
}

/// Test that was fitted.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TestRecord {
    /// Name of its table.
    pub file: String,
    /// How the specimen was deformed: uniaxial, planar or equibiaxial.
    pub test: String,
    /// RMS error, % of its largest stress.
    pub rms_percent: f64,
}

impl MaterialFile {
    /// Reads and checks the file.
    ///
    /// # Errors
    /// I/O error, invalid TOML, constants out of range.
    pub fn read(path: &Path) -> Result<Self, FormatError> {
        Self::parse(path, &file::read_text(path, file::MAX_TEXT_BYTES)?)
    }

    /// [`MaterialFile::read`] from memory; `path` is its name in errors.
    ///
    /// # Errors
    /// Invalid TOML, constants out of range.
    pub fn parse(path: &Path, text: &str) -> Result<Self, FormatError> {
        let wrong = |place: &str, expected: &str, found: String| {
            FormatError::one(path, Diagnostic::new(place, expected, found))
        };
        let this: Self = toml::from_str(text).map_err(|error| {
            wrong("content", "a file of `softtwin material fit`", error.to_string().trim_end().to_owned())
        })?;
        if this.layout != 1 {
            return Err(wrong("layout", "1", this.layout.to_string()));
        }
        this.elastomer.check().map_err(|e| wrong(e.name, e.expected, e.found.to_string()))?;
        Ok(this)
    }

    /// Source and range in one line.
    pub fn summary(&self) -> String {
        let law = self.elastomer.law.name();
        let range = self
            .elastomer
            .stretch_range
            .map_or_else(String::new, |[low, high]| format!(", stretches {low} to {high}"));
        match &self.fit {
            None => format!("{law}{range}"),
            Some(fit) => {
                let tests: Vec<String> =
                    fit.tests.iter().map(|test| format!("{} ({})", test.file, test.test)).collect();
                format!("{law}, fitted to {}, RMS {} %{range}", tests.join(", "), fit.rms_percent)
            }
        }
    }
}

/// Bulk modulus of a material file, MPa: rubber.
const BULK_MPA: f64 = 2000.0;

/// A number with six significant digits.
fn number(value: f64) -> f64 {
    format!("{value:.5e}").parse().unwrap_or(value)
}

/// The text of a material file for the law of some tests.
pub fn material_text(fitted: &FittedSpecimens, density_t_per_mm3: f64) -> String {
    let law = &fitted.best.law;
    let [low, high] = fitted.range;
    let mut out = format!(
        "# Made by `softtwin material fit`. In actuator.toml: [elastomer] file = \"this file\" in place of its other keys.\n\
         layout = 1\n\n[elastomer]\nbulk_mpa = {BULK_MPA:?}                # K\ndensity_t_per_mm3 = {:e}\n\
         stretch_range = [{:?}, {:?}]   # of a bar, reached by the tests; stable {}\n\n[elastomer.law]\nlaw = \"{}\"\n",
        density_t_per_mm3,
        number(low),
        number(high),
        fitted.best.stability(),
        law.key()
    );
    for ((name, value), half_width) in law.constants().iter().zip(&fitted.best.half_widths) {
        let interval = half_width.map_or_else(|| "open".into(), |h| format!("+- {h:.1e} (95 %)"));
        out += &format!("{name} = {:?}   # {interval}\n", number(*value));
    }
    out += &format!(
        "\n[fit]\nrms_percent = {:?}          # of the largest stress\n",
        number(100.0 * fitted.best.error)
    );
    if let Some(error) = fitted.best.working_error {
        out += &format!(
            "working_strains_percent = {:?}   # of the stress at strains of 2 to 30 %\n",
            number(100.0 * error)
        );
    }
    for specimen in &fitted.specimens {
        out += &format!(
            "\n[[fit.tests]]\nfile = {}\ntest = \"{}\"\nrms_percent = {:?}\n",
            toml::Value::from(specimen.name.as_str()),
            specimen.kind.word(),
            number(specimen.test.error_percent(law)[0])
        );
    }
    out
}
