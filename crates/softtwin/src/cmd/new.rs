//! `softtwin new`: a folder with a commented actuator file.

use crate::failure::usage;
use crate::files::{quoted, refusal};
use crate::{output, report};
use anyhow::Result;
use fem::actuator::{
    Actuator, NewActuator, NewBoxes, NewError, NewMaterial, NewReport, NewShape, cross_section,
};
use fem::material::silicone::{HardnessFigure, SILICONES, Silicone, named};
use formats::file;
use std::fmt::Display;
use std::io::{BufRead, IsTerminal, Write};
use std::path::PathBuf;
use std::str::FromStr;

const EXAMPLES: &str = "\
Example: a finger of six chambers, 100 mm long, and its twin
  softtwin new finger6 --chambers 6 --length-mm 100 --silicone elastosil-m4601
  softtwin build finger6 --quick

Without options on a terminal it asks for chambers, length, wall and silicone. Every other length follows the proportions of \
the reference actuator; actuator.toml explains each, and all of them may be changed there.";

/// Wall of a chamber that is not given, mm.
const WALL_MM: f64 = 2.5;
/// Sag as a fraction of the length from which hanging is advised.
const HANGING_SHARE: f64 = 0.15;

/// A number of the range that the library accepts.
fn range_of([low, high]: [f64; 2]) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync {
    crate::range::number(low, high)
}

/// Create a new actuator: a folder with a commented actuator.toml.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Folder to make.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Name of files and topics; the folder's own when left out.
    #[arg(long, value_name = "NAME")]
    name: Option<String>,
    /// Number of chambers (1 to 100) [default: 11].
    #[arg(long, value_name = "N", value_parser = crate::range::count(NewActuator::CHAMBERS[0], NewActuator::CHAMBERS[1]), help_heading = "Shape")]
    chambers: Option<usize>,
    /// Whole length in mm (10 to 2000) [default: 9 mm a chamber].
    #[arg(long, value_name = "MM", value_parser = range_of(NewActuator::LENGTH_MM), help_heading = "Shape")]
    length_mm: Option<f64>,
    /// Width of the body, the block of chambers, in mm (5 to 600); the base is 1.6 times as wide [default: 20].
    #[arg(long, value_name = "MM", value_parser = range_of(NewActuator::WIDTH_MM), help_heading = "Shape")]
    width_mm: Option<f64>,
    /// Wall between cavity and slot in mm (0.5 to 20); the top is 0.8 and a side 1.2 of it [default: 2.5].
    #[arg(long, value_name = "MM", value_parser = range_of(NewActuator::WALL_MM), help_heading = "Shape")]
    wall_mm: Option<f64>,
    /// Instead of a finger: a mesh file of your own with named surfaces (.msh, .inp, .vtu; docs/own-mesh.md), which is copied.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["chambers", "length_mm", "width_mm", "wall_mm"], help_heading = "Shape")]
    mesh: Option<PathBuf>,
    /// Surface of the mesh that is held.
    #[arg(long, value_name = "NAME", default_value = "clamp", requires = "mesh", help_heading = "Shape")]
    fixed: String,
    /// Silicone: with a public tension test dragon-skin-30, -20, -10-medium, ecoflex-00-50, -00-30, -00-10, the printed ninjaflex; by published
    /// constants alone reference, elastosil-m4601. Your own tests: --material.
    #[arg(long, value_name = "NAME", value_parser = named, help_heading = "Material")]
    silicone: Option<&'static Silicone>,
    /// Instead: a neo-Hookean silicone of this shear modulus in MPa (0.005 to 10).
    #[arg(long, value_name = "MPA", conflicts_with = "silicone", value_parser = range_of(NewActuator::SHEAR_MPA), help_heading = "Material")]
    shear_modulus_mpa: Option<f64>,
    /// Instead: the material file that `softtwin material fit` made of your tests.
    #[arg(long, value_name = "FILE.toml", conflicts_with_all = ["silicone", "shear_modulus_mpa"], help_heading = "Material")]
    material: Option<PathBuf>,
    /// Only a data sheet: Shore A hardness (5 to 80). The constants get a wide interval, which `softtwin build` carries on.
    #[arg(long, value_name = "HARDNESS", group = "sheet", conflicts_with_all = ["silicone", "shear_modulus_mpa", "material"], value_parser = range_of(NewActuator::SHORE_A), help_heading = "Material")]
    shore_a: Option<f64>,
    /// Only a data sheet: Shore 00 hardness (10 to 60).
    #[arg(long, value_name = "HARDNESS", group = "sheet", conflicts_with_all = ["silicone", "shear_modulus_mpa", "material"], value_parser = range_of(NewActuator::SHORE_00), help_heading = "Material")]
    shore_00: Option<f64>,
    /// Only a data sheet: nominal stress at 100 % elongation in MPa (0.01 to 10).
    #[arg(long, value_name = "MPA", group = "sheet", conflicts_with_all = ["silicone", "shear_modulus_mpa", "material"], value_parser = range_of(NewActuator::MODULUS_100_MPA), help_heading = "Material")]
    modulus_100_mpa: Option<f64>,
    /// Elongation at break in %, the end of the range of stretches (10 to 2000).
    #[arg(long, value_name = "PERCENT", requires = "sheet", value_parser = range_of(NewActuator::ELONGATION_PERCENT), help_heading = "Material")]
    elongation_percent: Option<f64>,
    /// Hangs down, base along the wall it is to touch; level when left out. Soft long fingers carry their weight only so.
    #[arg(long, help_heading = "Shape")]
    hanging: bool,
}

impl Args {
    /// Makes the folder and says what to do next.
    ///
    /// # Errors
    /// The folder is not empty or the shape cannot be built; I/O errors.
    pub fn run(mut self) -> Result<()> {
        let folder = || self.folder.file_name().map(|name| name.to_string_lossy().into_owned());
        let name = self.name.clone().or_else(folder).unwrap_or_default();
        let refused = |error| match error {
            NewError::Refused(_) => usage(error),
            NewError::Files(error) => refusal(error),
        };
        NewActuator::check_place(&name, &self.folder).map_err(refused)?;
        self.ask()?;
        let fitted = self.material.as_ref().map(|path| file::read_text(path, file::MAX_TEXT_BYTES));
        let fitted = fitted.transpose().map_err(refusal)?;
        let boxes = NewBoxes {
            chambers: self.chambers.unwrap_or(11),
            length_mm: self.length_mm,
            width_mm: self.width_mm.unwrap_or(20.0),
            wall_mm: self.wall_mm.unwrap_or(WALL_MM),
        };
        let new = NewActuator {
            name: &name,
            shape: match &self.mesh {
                Some(file) => NewShape::Mesh { file, fixed: &self.fixed },
                None => NewShape::Boxes(boxes),
            },
            hanging: self.hanging,
            material: self.material(fitted.as_deref()),
        };
        let (mut report, actuator) = new.create(&self.folder).map_err(refused)?;
        report.remarks = self.remarks(&report, &actuator);
        report::print(&report, false)
    }

    /// The cross-section, and what to do next.
    fn remarks(&self, report: &NewReport, actuator: &Actuator) -> Vec<String> {
        let folder = quoted(&self.folder);
        let section = actuator.shape().map(|shape| cross_section(&shape));
        let drawn = section.map(|section| format!("cross-section through a chamber, mm:\n{section}"));
        let mut remarks: Vec<String> = drawn.into_iter().collect();
        let length_mm = report.boxes.as_ref().map_or(f64::INFINITY, |boxes| boxes.length_mm);
        if self.hanging {
            remarks.push("it hangs: its weight pulls along it".into());
        } else if report.sag_mm.is_some_and(|sag_mm| sag_mm > HANGING_SHARE * length_mm) {
            remarks.push("--hanging mounts it vertically, where it does not sag".into());
        }
        remarks.push(format!(
            "look at it and change what you like, then make its twin:\n  softtwin build {folder} --quick    few states, for a first look\n  \
             softtwin build {folder}            for use"
        ));
        remarks
    }

    fn material<'a>(&self, fitted: Option<&'a str>) -> NewMaterial<'a> {
        match (fitted, self.figure(), self.shear_modulus_mpa) {
            (Some(text), ..) => NewMaterial::File(text),
            (None, Some(figure), _) => NewMaterial::DataSheet(figure, self.elongation_percent),
            (None, None, Some(shear_mpa)) => NewMaterial::Shear(shear_mpa),
            (None, None, None) => NewMaterial::Published(self.silicone.unwrap_or(&SILICONES[0])),
        }
    }

    /// The figure of a data sheet, if one was given.
    fn figure(&self) -> Option<HardnessFigure> {
        let shore_a = self.shore_a.map(HardnessFigure::ShoreA);
        let shore = shore_a.or(self.shore_00.map(HardnessFigure::Shore00));
        shore.or(self.modulus_100_mpa.map(HardnessFigure::Modulus100))
    }

    /// Asks on a terminal for what was not given, unless something was.
    fn ask(&mut self) -> Result<()> {
        let given = self.mesh.is_some()
            || self.chambers.is_some()
            || self.length_mm.is_some()
            || self.wall_mm.is_some();
        let material = self.silicone.is_some()
            || self.shear_modulus_mpa.is_some()
            || self.material.is_some()
            || self.figure().is_some();
        if given || material || !std::io::stdin().is_terminal() {
            return Ok(());
        }
        self.chambers = Some(ask("number of chambers", 11)?);
        self.length_mm = ask("length in mm, 0 for 9 mm a chamber", 0.0).map(|mm| (mm > 0.0).then_some(mm))?;
        self.wall_mm = Some(ask("wall between cavity and slot in mm", 2.5)?);
        for silicone in &SILICONES {
            output!(
                "  {:<21} shear modulus {} MPa; {}",
                silicone.name,
                silicone.shear_mpa,
                silicone.evidence()
            )?;
        }
        let name: String = ask("silicone", SILICONES[0].name.to_owned())?;
        self.silicone = Some(named(&name).map_err(usage)?);
        Ok(())
    }
}

/// Asks for a value on the terminal; an empty line takes the one in brackets.
fn ask<T: FromStr<Err: Display> + Display>(what: &str, default: T) -> Result<T> {
    let mut error = std::io::stderr();
    write!(error, "{what} [{default}]: ")?;
    error.flush()?;
    let mut line = String::new();
    std::io::stdin().lock().read_line(&mut line)?;
    match line.trim() {
        "" => Ok(default),
        text => text.parse().map_err(|e| usage(format!("{what}: {e}, found `{text}`"))),
    }
}
