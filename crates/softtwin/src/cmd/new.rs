//! `softtwin new`: a folder with a commented actuator file.

use crate::failure::usage;
use crate::files::{quoted, refusal, save};
use crate::{output, report};
use anyhow::{Context, Result};
use fem::actuator::{Actuator, NewActuator, NewMaterial, cross_section};
use fem::material::silicone::{HardnessFigure, SILICONES, Silicone, named};
use serde::Serialize;
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
    #[arg(long, value_name = "N", value_parser = crate::range::count(1, 100), help_heading = "Shape")]
    chambers: Option<usize>,
    /// Whole length in mm (10 to 2000) [default: 9 mm a chamber].
    #[arg(long, value_name = "MM", value_parser = crate::range::number(10.0, 2000.0), help_heading = "Shape")]
    length_mm: Option<f64>,
    /// Width of the body, the block of chambers, in mm (5 to 600); the base is 1.6 times as wide [default: 20].
    #[arg(long, value_name = "MM", value_parser = crate::range::number(5.0, 600.0), help_heading = "Shape")]
    width_mm: Option<f64>,
    /// Wall between cavity and slot in mm (0.5 to 20); the top is 0.8 and a side 1.2 of it [default: 2.5].
    #[arg(long, value_name = "MM", value_parser = crate::range::number(0.5, 20.0), help_heading = "Shape")]
    wall_mm: Option<f64>,
    /// Silicone: with a public tension test dragon-skin-30, -20, -10-medium, ecoflex-00-50, -00-30, -00-10, the printed ninjaflex; by published
    /// constants alone reference, elastosil-m4601. Your own tests: `softtwin material fit`.
    #[arg(long, value_name = "NAME", value_parser = named, help_heading = "Material")]
    silicone: Option<&'static Silicone>,
    /// Instead: a neo-Hookean silicone of this shear modulus in MPa (0.005 to 10).
    #[arg(long, value_name = "MPA", conflicts_with = "silicone", value_parser = crate::range::number(0.005, 10.0), help_heading = "Material")]
    shear_modulus_mpa: Option<f64>,
    /// Only a data sheet: Shore A hardness (5 to 80). The constants get a wide interval, which `softtwin build` carries on.
    #[arg(long, value_name = "HARDNESS", group = "sheet", conflicts_with_all = ["silicone", "shear_modulus_mpa"], value_parser = crate::range::number(5.0, 80.0), help_heading = "Material")]
    shore_a: Option<f64>,
    /// Only a data sheet: Shore 00 hardness (10 to 60).
    #[arg(long, value_name = "HARDNESS", group = "sheet", conflicts_with_all = ["silicone", "shear_modulus_mpa"], value_parser = crate::range::number(10.0, 60.0), help_heading = "Material")]
    shore_00: Option<f64>,
    /// Only a data sheet: nominal stress at 100 % elongation in MPa (0.01 to 10).
    #[arg(long, value_name = "MPA", group = "sheet", conflicts_with_all = ["silicone", "shear_modulus_mpa"], value_parser = crate::range::number(0.01, 10.0), help_heading = "Material")]
    modulus_100_mpa: Option<f64>,
    /// Elongation at break in %, the end of the range of stretches (10 to 2000).
    #[arg(long, value_name = "PERCENT", requires = "sheet", value_parser = crate::range::number(10.0, 2000.0), help_heading = "Material")]
    elongation_percent: Option<f64>,
    /// Hangs down, base along the wall it is to touch; level when left out. Soft long fingers carry their weight only so.
    #[arg(long, help_heading = "Shape")]
    hanging: bool,
}

/// The new folder.
#[derive(Serialize)]
struct NewReport {
    actuator: PathBuf,
    chambers: usize,
    length_mm: f64,
    thinnest_wall_mm: f64,
    cavity_length_mm: f64,
    pitch_mm: f64,
    wall_mm: f64,
    shear_modulus_mpa: f64,
    /// Where it may be, if only a data sheet is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    shear_interval_mpa: Option<[f64; 2]>,
    silicone: String,
    /// Of the tip under its own weight, by beam theory; `None` of one that hangs.
    sag_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    sag_interval_mm: Option<[f64; 2]>,
    remarks: Vec<String>,
}

impl Args {
    /// Makes the folder and says what to do next.
    ///
    /// # Errors
    /// The folder is not empty or the shape cannot be built; I/O errors.
    pub fn run(mut self) -> Result<()> {
        let name = self.name()?;
        let folder = quoted(&self.folder);
        if std::fs::read_dir(&self.folder).is_ok_and(|mut entries| entries.next().is_some()) {
            return Err(usage(format!(
                "{}: expected a new or an empty folder, found one with files; choose another, or change its actuator.toml and run \
                 `softtwin build {folder}`",
                self.folder.display()
            )));
        }
        self.ask()?;
        let new = NewActuator {
            name: &name,
            chambers: self.chambers.unwrap_or(11),
            length_mm: self.length_mm,
            width_mm: self.width_mm.unwrap_or(20.0),
            wall_mm: self.wall_mm.unwrap_or(WALL_MM),
            hanging: self.hanging,
            material: self.material(),
        };
        let text = new.text(&folder).map_err(usage)?;
        // The same checks as when it is read: a shape that cannot be built never reaches the disk.
        let path = self.folder.join("actuator.toml");
        let actuator = Actuator::parse(&text).map_err(|diagnostics| {
            refusal(formats::FormatError::Content { path: path.clone(), diagnostics })
        })?;
        formats::file::create_folder(&self.folder)?;
        save(&path, text.as_bytes())?;
        report::print(&self.report(path, &actuator, new.wall_mm)?, false)
    }

    fn report(&self, path: PathBuf, actuator: &Actuator, wall_mm: f64) -> Result<NewReport> {
        let shape = actuator.shape().context("the new actuator has no boxes")?;
        let length_mm = shape.base.length_mm;
        let [first, last] = shape.chambers.along_mm(0);
        let (shear, interval) =
            (actuator.elastomer.law.shear_modulus_mpa(), actuator.elastomer.shear_interval_mpa);
        let sag = |factor: f64| actuator.sag_estimate_mm(factor).filter(|_| !self.hanging);
        let folder = quoted(&self.folder);
        let mut remarks = vec![format!("cross-section through a chamber, mm:\n{}", cross_section(&shape))];
        if self.hanging {
            remarks.push("it hangs: its weight pulls along it".into());
        } else if sag(1.0).is_some_and(|sag_mm| sag_mm > HANGING_SHARE * length_mm) {
            remarks.push("--hanging mounts it vertically, where it does not sag".into());
        }
        remarks.push(format!(
            "look at it and change what you like, then make its twin:\n  softtwin build {folder} --quick    few states, for a first look\n  \
             softtwin build {folder}            for use"
        ));
        Ok(NewReport {
            actuator: path,
            chambers: shape.chambers.count,
            length_mm,
            thinnest_wall_mm: shape.thinnest_wall_mm(),
            cavity_length_mm: last - first,
            pitch_mm: shape.chambers.pitch_mm,
            wall_mm,
            shear_modulus_mpa: shear,
            shear_interval_mpa: interval,
            silicone: match self.material() {
                NewMaterial::DataSheet(figure, _) => {
                    let narrows =
                        "a tension test to the strains of use narrows it most: softtwin material fit";
                    format!("{}; {narrows}", figure.source())
                }
                NewMaterial::Shear(_) => "neo-Hookean, as given".into(),
                NewMaterial::Published(silicone) => format!("{}; {}", silicone.name, silicone.evidence()),
            },
            sag_mm: sag(1.0),
            sag_interval_mm: interval.and_then(|[low, high]| Some([sag(high / shear)?, sag(low / shear)?])),
            remarks,
        })
    }

    fn material(&self) -> NewMaterial {
        match (self.figure(), self.shear_modulus_mpa) {
            (Some(figure), _) => NewMaterial::DataSheet(figure, self.elongation_percent),
            (None, Some(shear_mpa)) => NewMaterial::Shear(shear_mpa),
            (None, None) => NewMaterial::Published(self.silicone.unwrap_or(&SILICONES[0])),
        }
    }

    /// The figure of a data sheet, if one was given.
    fn figure(&self) -> Option<HardnessFigure> {
        let shore_a = self.shore_a.map(HardnessFigure::ShoreA);
        let shore = shore_a.or(self.shore_00.map(HardnessFigure::Shore00));
        shore.or(self.modulus_100_mpa.map(HardnessFigure::Modulus100))
    }

    fn name(&self) -> Result<String> {
        let folder = || self.folder.file_name().map(|name| name.to_string_lossy().into_owned());
        let name = self.name.clone().or_else(folder).unwrap_or_default();
        let fits = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if name.is_empty() || name.len() > 64 || !name.chars().all(fits) {
            let expected = "1 to 64 letters, digits, - and _ (it names files and topics)";
            return Err(usage(format!("--name: expected {expected}, found `{name}`; give --name")));
        }
        Ok(name)
    }

    /// Asks on a terminal for what was not given, unless something was.
    fn ask(&mut self) -> Result<()> {
        let given = self.chambers.is_some() || self.length_mm.is_some() || self.wall_mm.is_some();
        let material = self.silicone.is_some() || self.shear_modulus_mpa.is_some() || self.figure().is_some();
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
