//! Description of a tensile test's table: columns, quantities, units, specimen.

use crate::failure::configuration;
use crate::files::refusal;
use anyhow::{Result, anyhow};
use fem::material::Deformation;
use formats::file;
use formats::log::Column;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Kind of test.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Bar or strip in tension, free sideways.
    Uniaxial,
    /// Wide strip (pure shear).
    Planar,
    /// Equal tension in two directions, or a balloon's pole.
    Biaxial,
    /// Cylinder between lubricated plates; strain and stress may be given as positive numbers.
    Compression,
}

impl Kind {
    /// Deformation.
    pub fn deformation(self) -> Deformation {
        match self {
            Self::Uniaxial | Self::Compression => Deformation::Uniaxial,
            Self::Planar => Deformation::Planar,
            Self::Biaxial => Deformation::Biaxial,
        }
    }
}

/// Measured deformation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Extension {
    /// Engineering strain: elongation over length.
    Strain,
    /// Logarithmic strain.
    TrueStrain,
    /// Stretch: length over undeformed length.
    Stretch,
    /// Elongation (needs the specimen's length).
    Displacement,
    /// Length (needs the undeformed one).
    Length,
}

/// Measured load.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Load {
    /// Force over undeformed cross-section.
    NominalStress,
    /// Force over deformed cross-section (Cauchy).
    TrueStress,
    /// Force (needs the specimen's cross-section).
    Force,
}

/// Branch of a test that is fitted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Branch {
    /// First loading: the rows that reach farther than all before.
    #[default]
    First,
    /// Loading of the last cycle, of a preconditioned specimen.
    Last,
}

/// Origin of deformation and load.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Origin {
    /// That of the table.
    #[default]
    Table,
    /// The strain at which the stress of the first 30 % extrapolates to 0.
    Slack,
    /// The stress to which the first 30 % extrapolate at no strain.
    Load,
}

/// One column.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Channel<Q> {
    /// Number from 1, or heading.
    pub column: Option<Column>,
    /// Quantity.
    pub quantity: Option<Q>,
    /// Unit.
    pub unit: Option<String>,
}

impl<Q> Channel<Q> {
    fn unknown() -> Self {
        Self { column: None, quantity: None, unit: None }
    }
}

/// One test.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Description {
    /// Table.
    pub file: PathBuf,
    /// Kind; by default from the file's name.
    pub test: Option<Kind>,
    /// Weight of the test's error.
    #[serde(default = "one")]
    pub weight: f64,
    /// True if the specimen has another modulus than the part: the test tells the shape of the law only.
    #[serde(default)]
    pub shape_only: bool,
    /// Deformation.
    #[serde(default = "Channel::unknown")]
    pub deformation: Channel<Extension>,
    /// Load.
    #[serde(default = "Channel::unknown")]
    pub load: Channel<Load>,
    /// Undeformed length between the marks or clamps, mm.
    pub length_mm: Option<f64>,
    /// Undeformed cross-section, mm2.
    pub area_mm2: Option<f64>,
    /// Branch.
    #[serde(default)]
    pub branch: Branch,
    /// Origin.
    #[serde(default)]
    pub origin: Origin,
}

fn one() -> f64 {
    1.0
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct List {
    test: Vec<Description>,
}

/// Reads the descriptions of several tests; files are relative to the list's folder.
pub fn read(path: &Path) -> Result<Vec<Description>> {
    let text = file::read_text(path, file::MAX_TEXT_BYTES).map_err(refusal)?;
    let list: List = toml::from_str(&text).map_err(|error| {
        configuration(anyhow!(
            "{}: expected [[test]] with file, test, deformation, load, length_mm, area_mm2; {error}",
            path.display()
        ))
    })?;
    let place = |test: Description| Description { file: file::named_in(path, &test.file), ..test };
    if list.test.iter().all(|test| test.shape_only) && !list.test.is_empty() {
        return Err(configuration(anyhow!(
            "{}: shape_only: expected a test without it, which tells the modulus, found none",
            path.display()
        )));
    }
    list.test
        .into_iter()
        .map(place)
        .map(|test| {
            let sizes =
                [("weight", Some(test.weight)), ("length_mm", test.length_mm), ("area_mm2", test.area_mm2)];
            match sizes.into_iter().find(|(_, value)| value.is_some_and(|v| !(v.is_finite() && v > 0.0))) {
                Some((name, found)) => Err(configuration(anyhow!(
                    "{}: {name} of {}: expected a finite number above 0, found {}",
                    path.display(),
                    test.file.display(),
                    found.unwrap_or(f64::NAN)
                ))),
                None => Ok(test),
            }
        })
        .collect()
}
