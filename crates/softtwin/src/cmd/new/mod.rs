//! `softtwin new`: a folder with a commented actuator file.

mod data_sheet;
mod shape;
mod silicone;
mod text;

use crate::failure::usage;
use crate::files::{quoted, refusal, save};
use crate::output;
use anyhow::{Context, Result};
use data_sheet::Figure;
use fem::actuator::Actuator;
use shape::{Entry, Shape};
use silicone::{SILICONES, Silicone};
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
    #[arg(long, value_name = "NAME", value_parser = silicone::named, help_heading = "Material")]
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

impl Args {
    /// Makes the folder and says what to do next.
    ///
    /// # Errors
    /// The folder is not empty or the shape cannot be built; I/O errors.
    pub fn run(mut self) -> Result<()> {
        let name = self.name()?;
        if std::fs::read_dir(&self.folder).is_ok_and(|mut entries| entries.next().is_some()) {
            return Err(usage(format!(
                "{}: expected a new or an empty folder, found one with files; choose another, or change its actuator.toml and run \
                 `softtwin build {}`",
                self.folder.display(),
                quoted(&self.folder)
            )));
        }
        self.ask()?;
        let text = self.text(&name)?;
        // The same checks as when it is read: a shape that cannot be built never reaches the disk.
        let path = self.folder.join("actuator.toml");
        let actuator = Actuator::parse(&text).map_err(|diagnostics| {
            refusal(formats::FormatError::Content { path: path.clone(), diagnostics })
        })?;
        formats::file::create_folder(&self.folder)?;
        save(&path, text.as_bytes())?;
        let shape = actuator.shape().context("the new actuator has no boxes")?;
        let (chambers, length_mm) = (shape.chambers.count, shape.base.length_mm);
        output!(
            "{}: {chambers} chambers, {length_mm} mm long, thinnest wall {:.2} mm",
            path.display(),
            shape.thinnest_wall_mm()
        )?;
        output!("cross-section through a chamber, mm:\n{}", shape::cross_section(&shape))?;
        let [first, last] = shape.chambers.along_mm(0);
        output!(
            "along x: cavities {:.2} mm long, {} mm apart, walls {:.2} mm",
            last - first,
            shape.chambers.pitch_mm,
            self.wall_mm.unwrap_or(WALL_MM)
        )?;
        self.print_material(&actuator)?;
        self.print_sag(&actuator, length_mm)?;
        output!("look at it and change what you like, then make its twin:")?;
        output!("  softtwin build {} --quick    few states, for a first look", quoted(&self.folder))?;
        output!("  softtwin build {}            for use", quoted(&self.folder))?;
        Ok(())
    }

    /// Figure of a data sheet.
    fn figure(&self) -> Option<Figure> {
        let shore_a = self.shore_a.map(Figure::ShoreA);
        shore_a.or(self.shore_00.map(Figure::Shore00)).or(self.modulus_100_mpa.map(Figure::Modulus100))
    }

    fn print_material(&self, actuator: &Actuator) -> Result<()> {
        let shear = actuator.elastomer.law.shear_modulus_mpa();
        match (self.figure(), actuator.elastomer.shear_interval_mpa) {
            (Some(figure), Some([low, high])) => {
                output!(
                    "silicone: initial shear modulus {shear:.4} MPa, anywhere from {low:.4} to {high:.4} MPa ({}); a tension test to the \
                     strains of use narrows it most: softtwin material fit",
                    figure.source()
                )?;
            }
            _ if self.shear_modulus_mpa.is_some() => {
                output!("silicone: neo-Hookean, shear modulus {shear} MPa, as given")?
            }
            _ => {
                let silicone = self.silicone.unwrap_or(&SILICONES[0]);
                output!(
                    "silicone: {}, initial shear modulus {shear:.4} MPa; {}",
                    silicone.name,
                    silicone.evidence()
                )?;
            }
        }
        Ok(())
    }

    /// Sag under the actuator's weight, by beam theory.
    fn print_sag(&self, actuator: &Actuator, length_mm: f64) -> Result<()> {
        if self.hanging {
            output!("it hangs: its weight pulls along it")?;
            return Ok(());
        }
        let estimate = |factor: f64| actuator.sag_estimate_mm(factor).unwrap_or(f64::NAN);
        let sag = estimate(1.0);
        let band = actuator.elastomer.shear_interval_mpa.map_or_else(String::new, |interval| {
            let shear = actuator.elastomer.law.shear_modulus_mpa();
            let [most, least] = interval.map(|mpa| estimate(mpa / shear));
            format!(" ({least:.0} to {most:.0} mm over the interval of its silicone)")
        });
        let share = sag / length_mm;
        let advice = if share > HANGING_SHARE {
            "; --hanging mounts it vertically, where it does not sag"
        } else {
            ""
        };
        output!(
            "own weight: the tip sags by about {sag:.1} mm of {length_mm:.0} mm{band} by beam theory{advice}"
        )?;
        Ok(())
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
        self.silicone = Some(silicone::named(&name).map_err(usage)?);
        Ok(())
    }

    fn text(&self, name: &str) -> Result<String> {
        let shape = Shape {
            chambers: self.chambers.unwrap_or(11),
            length_mm: self.length_mm,
            width_mm: self.width_mm.unwrap_or(20.0),
            wall_mm: self.wall_mm.unwrap_or(WALL_MM),
        };
        let mut entries: Vec<Entry> = shape.entries().map_err(usage)?;
        let silicone = self.silicone.unwrap_or(&SILICONES[0]);
        let mut elastomer = String::new();
        let law = match (self.figure(), self.shear_modulus_mpa) {
            (Some(figure), _) => {
                let estimate = figure.estimate();
                let [low, high] = estimate.interval_mpa.map(rounded);
                elastomer = format!(
                    "shear_interval_mpa = [{low:?}, {high:?}] # MPa, of the initial shear modulus, by the data sheet\n"
                );
                if let Some(percent) = self.elongation_percent {
                    elastomer += &format!(
                        "stretch_range = [1.0, {:?}]      # to the elongation at break\n",
                        rounded(1.0 + 0.01 * percent)
                    );
                }
                let mu = rounded(estimate.shear_mpa);
                format!("# {}.\nlaw = \"neo-hookean\"\nmu_mpa = {mu:?}\n", figure.source())
            }
            (None, Some(mu)) => {
                format!("# Own constant: a neo-Hookean silicone.\nlaw = \"neo-hookean\"\nmu_mpa = {mu:?}\n")
            }
            (None, None) => {
                let lines: String =
                    silicone.law.iter().map(|(key, value)| format!("{key} = {value}\n")).collect();
                entries.push(("elastomer", "density_t_per_mm3", silicone.density_t_per_mm3.into()));
                if let Some(test) = &silicone.test {
                    elastomer =
                        format!("stretch_range = [1.0, {:?}]        # of a bar, fitted\n", test.stretch);
                }
                format!("# {}: {}.\n{lines}", silicone.name, silicone.evidence())
            }
        };
        entries.push(("", "name", format!("\"{name}\"")));
        if self.hanging {
            entries.push(("loads", "gravity_mm_s2", "[9810.0, 0.0, 0.0]".into()));
        }
        let folder = quoted(&self.folder);
        let heading = format!(
            "# {name}: a soft pneumatic actuator, begun by `softtwin new`. `softtwin build {folder}` makes its mesh, its states and its\n\
             # twin. After a change here run it again.\n#\n"
        );
        Ok(text::compose(&heading, &entries, [&elastomer, &law], 2.0 * shape.wall_mm))
    }
}

/// Three significant digits.
fn rounded(value: f64) -> f64 {
    format!("{value:.2e}").parse().unwrap_or(value)
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
