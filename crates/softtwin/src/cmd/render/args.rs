//! The arguments of `softtwin render`.

use crate::failure::usage;
use crate::options::setting;
use crate::picture::camera::Camera;
use crate::picture::theme::ThemeName;
use anyhow::Result;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  One state, the plate 40 mm below the base:
    softtwin render --model models/pneunet/pneunet.twin \\
      --pressure-mpa 0.05 --gap-mm 40 --out state.png
  The same seen from the side, coloured by displacement, for a dark page:
    softtwin render --model finger.twin --pressure-mpa 0.05 --gap-mm 40 \\
      --view side --field displacement --theme dark --out state.png
  The modes of the contact regime (the paper's Fig. 6):
    softtwin render --model finger.twin --modes contact --out modes.png
  Three gaps at five pressures with their contact forces (the paper's Fig. 9):
    softtwin render --model finger.twin --fig9 --out scenes.png
  A whole scene: both fingers of the gripper and the block between them
    softtwin render --scene config/scenes/gripper.toml \\
      --pressure-mpa 0.079 --view side --out gripper.png
  The markers of a measured model:
    softtwin render --model arm.twin --set p_seg1_a_mpa=0.02 --out arm.png
  A case of a database, as computed by the finite elements:
    softtwin render --database models/pneunet/database --case 17 --out case.png";

/// Largest pressure and gap that are drawn.
const MAX_PRESSURE_MPA: f64 = 100.0;
const MAX_GAP_MM: f64 = 10_000.0;

/// Draw states or modes as PNG pictures, without a display.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES)]
pub struct Args {
    /// Trained model.
    #[arg(long, value_name = "FILE", required_unless_present_any = ["database", "scene"])]
    pub model: Option<PathBuf>,
    /// Scene file: all its actuators in their places, with its blocks.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["model", "database", "modes", "fig9"])]
    pub scene: Option<PathBuf>,
    /// Database folder to draw a case of.
    #[arg(long, value_name = "DIR", conflicts_with = "model", requires = "case")]
    pub database: Option<PathBuf>,
    /// Case of the database, by its name.
    #[arg(long, value_name = "NAME", requires = "database", help_heading = "State")]
    pub case: Option<String>,
    /// Pressure in the chambers, MPa (0 to 100).
    #[arg(long, value_name = "MPA", value_parser = crate::range::pressure_mpa, help_heading = "State")]
    pub pressure_mpa: Option<f64>,
    /// Gap from the underside of the undeformed base to the plate, mm (0 to 10000); no plate when left out.
    #[arg(long, value_name = "MM", value_parser = crate::range::gap_mm, help_heading = "State")]
    pub gap_mm: Option<f64>,
    /// Another input of the model; default: its nominal value.
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = setting, requires = "model", help_heading = "State")]
    pub settings: Vec<(String, f64)>,
    /// Draw the POD modes of a regime: free or contact.
    #[arg(long, value_name = "REGIME", conflicts_with_all = ["pressure_mpa", "gap_mm", "fig9", "database", "settings"], help_heading = "State")]
    pub modes: Option<String>,
    /// Draw gaps 80, 40 and 15 mm at 0.01, 0.025, 0.04, 0.055 and 0.07 MPa, or states in the model's training range.
    #[arg(long, conflicts_with_all = ["pressure_mpa", "gap_mm", "database"], help_heading = "State")]
    pub fig9: bool,
    /// Quantity shown as colour.
    #[arg(long, value_enum, default_value = "stress", help_heading = "Drawing")]
    pub field: Shown,
    /// Ends of the colour scale in the field's unit, LOW:HIGH; fitted to the picture when left out.
    #[arg(long, value_name = "LOW:HIGH", value_parser = parse_range, help_heading = "Drawing")]
    pub range: Option<[f32; 2]>,
    /// Direction of view.
    #[arg(long, value_enum, default_value = "oblique", help_heading = "Drawing")]
    pub view: View,
    /// Colours of the background.
    #[arg(long, value_enum, default_value = "light", help_heading = "Drawing")]
    pub theme: ThemeName,
    /// Width of one drawing, pixels (100 to 4000); the whole picture has at most 100 megapixels.
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u16).range(100..=4000), help_heading = "Drawing")]
    pub width: Option<u16>,
    /// Picture to write.
    #[arg(long, value_name = "FILE.png", help_heading = "Output")]
    pub out: PathBuf,
}

/// A field that can be shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Shown {
    /// Von Mises stress, MPa.
    Stress,
    /// Displacement magnitude, mm (for modes: the vertical coordinate).
    Displacement,
}

/// A direction of view, as typed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum View {
    /// From the side, a little from above and from the tip.
    Oblique,
    /// From the side.
    Side,
    /// From above.
    Top,
}

impl View {
    /// Its camera.
    pub fn camera(self) -> Camera {
        match self {
            Self::Oblique => Camera::new(24.0, 17.0),
            Self::Side => Camera::new(0.0, 0.0),
            Self::Top => Camera::new(0.0, 89.9),
        }
    }
}

impl Shown {
    /// Name in models and databases.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stress => "von_mises",
            Self::Displacement => "displacement",
        }
    }

    /// Label of the colour bar.
    pub fn label(self) -> &'static str {
        match self {
            Self::Stress => "von Mises stress (MPa)",
            Self::Displacement => "displacement (mm)",
        }
    }
}

fn parse_range(text: &str) -> Result<[f32; 2], String> {
    let ends: Option<[f32; 2]> = text
        .split_once(':')
        .and_then(|(low, high)| Some([low.trim().parse().ok()?, high.trim().parse().ok()?]))
        .filter(|[low, high]: &[f32; 2]| low < high && high.is_finite() && low.is_finite());
    ends.ok_or_else(|| format!("expected LOW:HIGH with LOW < HIGH, such as 0:0.5, found {text:?}"))
}

impl Args {
    /// The pressure (MPa) of the state to draw, checked together with the gap.
    pub fn pressure_mpa(&self) -> Result<f64> {
        let pressure = self.pressure_mpa.ok_or_else(|| {
            usage("which state? give --pressure-mpa (and --gap-mm), or --modes, or --fig9; see --help for examples")
        })?;
        let gap_mm = self.gap_mm.unwrap_or(0.0);
        if (0.0..=MAX_PRESSURE_MPA).contains(&pressure) && (0.0..=MAX_GAP_MM).contains(&gap_mm) {
            return Ok(pressure);
        }
        Err(usage(format!(
            "expected a pressure of 0 to {MAX_PRESSURE_MPA} MPa and a gap of 0 to {MAX_GAP_MM} mm, found {pressure} MPa, {gap_mm} mm"
        )))
    }
}

#[cfg(test)]
#[path = "../../../tests/unit/cmd_render_args.rs"]
mod tests;
