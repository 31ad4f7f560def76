//! The folder of a new actuator: `actuator.toml` from the few figures that people think in, checked before it is written.

use super::file::Actuator;
use super::reading::with_elastomer;
use super::template::{MATERIAL_FILE, NewActuator, NewBoxes, NewMaterial, NewShape, mesh_name};
use crate::material::MaterialFile;
use crate::material::silicone::HardnessFigure;
use formats::mesh_file::MeshFile;
use formats::{FormatError, file, read_mesh};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Largest mesh file that is copied.
const MAX_MESH_BYTES: u64 = 1 << 30;

/// Why a folder could not be made.
#[derive(Debug, thiserror::Error)]
pub enum NewError {
    /// What was asked for is out of range or does not fit together; the message names the option and what would.
    #[error("{0}")]
    Refused(String),
    /// The material file is wrong, or a file could not be written.
    #[error(transparent)]
    Files(#[from] FormatError),
}

/// Shape of a new finger.
#[derive(Debug, Serialize)]
pub struct BoxesReport {
    /// Number of chambers.
    pub chambers: usize,
    /// Length of the base, mm.
    pub length_mm: f64,
    /// The thinnest wall of a chamber, mm.
    pub thinnest_wall_mm: f64,
    /// Length of a cavity along the actuator, mm.
    pub cavity_length_mm: f64,
    /// Distance of the chambers, mm.
    pub pitch_mm: f64,
    /// Wall between cavity and slot, mm.
    pub wall_mm: f64,
}

/// The new folder.
#[derive(Debug, Serialize)]
pub struct NewReport {
    /// The actuator's file.
    pub actuator: PathBuf,
    /// Its shape, unless it is that of a mesh file.
    #[serde(flatten)]
    pub boxes: Option<BoxesReport>,
    /// Initial shear modulus of the silicone, MPa.
    pub shear_modulus_mpa: f64,
    /// Where it may be, if only a data sheet is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shear_interval_mpa: Option<[f64; 2]>,
    /// The silicone and what is known of it.
    pub silicone: String,
    /// Of the tip under its own weight, by beam theory; `None` of one that hangs.
    pub sag_mm: Option<f64>,
    /// Where the sag may be, if only a data sheet is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sag_interval_mm: Option<[f64; 2]>,
    /// What to look at and to do next.
    pub remarks: Vec<String>,
}

impl NewActuator<'_> {
    /// Smallest and largest number of chambers.
    pub const CHAMBERS: [usize; 2] = [1, 100];
    /// Shortest and longest actuator, mm.
    pub const LENGTH_MM: [f64; 2] = [10.0, 2000.0];
    /// Narrowest and widest body, mm.
    pub const WIDTH_MM: [f64; 2] = [5.0, 600.0];
    /// Thinnest and thickest wall, mm.
    pub const WALL_MM: [f64; 2] = [0.5, 20.0];
    /// Softest and stiffest neo-Hookean silicone, MPa.
    pub const SHEAR_MPA: [f64; 2] = [0.005, 10.0];
    /// Range of the relation from Shore A.
    pub const SHORE_A: [f64; 2] = [5.0, 80.0];
    /// Range of the relation from Shore 00.
    pub const SHORE_00: [f64; 2] = [10.0, 60.0];
    /// Range of the stress at 100 % elongation, MPa.
    pub const MODULUS_100_MPA: [f64; 2] = [0.01, 10.0];
    /// Range of the elongation at break, %.
    pub const ELONGATION_PERCENT: [f64; 2] = [10.0, 2000.0];

    /// Makes the folder, which must be new or empty, with `actuator.toml` and the material file, if there is one. Returns the report and
    /// the actuator. Nothing is written of a shape that cannot be built.
    ///
    /// # Errors
    /// The folder has files; a figure out of range; a shape that cannot be built; I/O errors.
    pub fn create(&self, folder: &Path) -> Result<(NewReport, Actuator), NewError> {
        Self::check_place(self.name, folder)?;
        self.check()?;
        let mesh = match self.shape {
            NewShape::Mesh { file, .. } => Some((file, read_mesh(file)?)),
            _ => None,
        };
        let further = mesh.as_ref().map_or_else(Vec::new, |(_, content)| further_cavities(content));
        let text = self.text(&file::quoted(folder), &further).map_err(NewError::Refused)?;
        let path = folder.join("actuator.toml");
        let content = |diagnostics| FormatError::Content { path: path.clone(), diagnostics };
        let (whole, material) = match self.material {
            NewMaterial::File(material) => {
                let elastomer = MaterialFile::parse(&folder.join(MATERIAL_FILE), material)?.elastomer;
                let whole = with_elastomer(&text, None, &elastomer).map_err(|found| content(vec![found]))?;
                (whole, Some(material))
            }
            _ => (text.clone(), None),
        };
        let actuator = Actuator::parse(&whole).map_err(content)?;
        let report = self.report(&path, &actuator)?;
        let mut copy = None;
        if let Some((file, content)) = mesh {
            actuator.mesh_of(file, content)?;
            copy = Some((mesh_name(file), file::read_bytes(file, MAX_MESH_BYTES)?));
        }
        file::create_folder(folder)?;
        if let Some((name, bytes)) = copy {
            file::replace(&folder.join(name), &bytes)?;
        }
        if let Some(material) = material {
            file::replace(&folder.join(MATERIAL_FILE), material.as_bytes())?;
        }
        file::replace(&path, text.as_bytes())?;
        Ok((report, actuator))
    }

    /// Checks name and folder, before anything else is asked for.
    ///
    /// # Errors
    /// A name that cannot name files and topics; a folder with files.
    pub fn check_place(name: &str, folder: &Path) -> Result<(), NewError> {
        let refused = |text: String| Err(NewError::Refused(text));
        let fits = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if name.is_empty() || name.len() > 64 || !name.chars().all(fits) {
            let expected = "1 to 64 letters, digits, - and _ (it names files and topics)";
            return refused(format!("--name: expected {expected}, found `{name}`; give --name"));
        }
        if std::fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some()) {
            return refused(format!(
                "{}: expected a new or an empty folder, found one with files; choose another, or change its actuator.toml and run \
                 `softtwin build {}`",
                folder.display(),
                file::quoted(folder)
            ));
        }
        Ok(())
    }

    fn check(&self) -> Result<(), NewError> {
        let mut figures = Vec::new();
        if let NewShape::Boxes(boxes) = self.shape {
            let [least, most] = Self::CHAMBERS;
            figures.extend([
                ("--chambers", Some(boxes.chambers as f64), [least as f64, most as f64]),
                ("--length-mm", boxes.length_mm, Self::LENGTH_MM),
                ("--width-mm", Some(boxes.width_mm), Self::WIDTH_MM),
                ("--wall-mm", Some(boxes.wall_mm), Self::WALL_MM),
            ]);
        }
        match self.material {
            NewMaterial::Shear(mpa) => figures.push(("--shear-modulus-mpa", Some(mpa), Self::SHEAR_MPA)),
            NewMaterial::DataSheet(figure, elongation_percent) => {
                figures.push(match figure {
                    HardnessFigure::ShoreA(hardness) => ("--shore-a", Some(hardness), Self::SHORE_A),
                    HardnessFigure::Shore00(hardness) => ("--shore-00", Some(hardness), Self::SHORE_00),
                    HardnessFigure::Modulus100(mpa) => {
                        ("--modulus-100-mpa", Some(mpa), Self::MODULUS_100_MPA)
                    }
                });
                figures.push(("--elongation-percent", elongation_percent, Self::ELONGATION_PERCENT));
            }
            NewMaterial::Published(_) | NewMaterial::File(_) => {}
        }
        for (option, value, [low, high]) in figures {
            if let Some(found) = value.filter(|value| !(low..=high).contains(value)) {
                return Err(NewError::Refused(format!("{option}: expected {low} to {high}, found {found}")));
            }
        }
        Ok(())
    }

    fn report(&self, path: &Path, actuator: &Actuator) -> Result<NewReport, FormatError> {
        let boxes = |boxes: &NewBoxes| {
            let shape = actuator.shape()?;
            let [first, last] = shape.chambers.along_mm(0);
            Some(BoxesReport {
                chambers: shape.chambers.count,
                length_mm: shape.base.length_mm,
                thinnest_wall_mm: shape.thinnest_wall_mm(),
                cavity_length_mm: last - first,
                pitch_mm: shape.chambers.pitch_mm,
                wall_mm: boxes.wall_mm,
            })
        };
        let (shear, interval) =
            (actuator.elastomer.law.shear_modulus_mpa(), actuator.elastomer.shear_interval_mpa);
        let sag = |factor: f64| actuator.sag_estimate_mm(factor).filter(|_| !self.hanging);
        Ok(NewReport {
            actuator: path.into(),
            boxes: if let NewShape::Boxes(shape) = &self.shape { boxes(shape) } else { None },
            shear_modulus_mpa: shear,
            shear_interval_mpa: interval,
            silicone: match self.material {
                NewMaterial::DataSheet(figure, _) => {
                    let narrows =
                        "a tension test to the strains of use narrows it most: softtwin material fit";
                    format!("{}; {narrows}", figure.source())
                }
                NewMaterial::Shear(_) => "neo-Hookean, as given".into(),
                NewMaterial::Published(silicone) => format!("{}; {}", silicone.name, silicone.evidence()),
                NewMaterial::File(text) => MaterialFile::parse(path, text)?.summary(),
            },
            sag_mm: sag(1.0),
            sag_interval_mm: interval.and_then(|[low, high]| Some([sag(high / shear)?, sag(low / shear)?])),
            remarks: Vec::new(),
        })
    }
}

/// Names of the cavities `cavity.NAME` of a mesh file.
fn further_cavities(mesh: &MeshFile) -> Vec<String> {
    mesh.surfaces.keys().filter_map(|name| Some(name.strip_prefix("cavity.")?.to_owned())).collect()
}
