//! States of bodies side by side, with one colour scale.

use crate::camera::Camera;
use crate::canvas::Canvas;
use crate::colour::ColourMap;
use crate::scale::Scale;
use crate::scene::{Block, Plate, Scene};
use crate::sheet::{Panel, Row, Sheet};
use crate::skin::DrawnBody;
use crate::theme::ThemeName;
use anyhow::Result;

/// Smallest width of a single drawing, in letter heights.
const TEXT_SHARE: f32 = 26.0;

/// How bodies are drawn.
#[derive(clap::Args)]
#[command(next_help_heading = "Drawing")]
pub struct Look {
    /// Quantity shown as colour.
    #[arg(long, value_enum, default_value = "stress")]
    pub field: ShownField,
    /// Ends of the colour scale in the field's unit, LOW:HIGH; fitted to the picture when left out.
    #[arg(long, value_name = "LOW:HIGH", value_parser = parse_range)]
    pub range: Option<[f32; 2]>,
    /// Direction of view.
    #[arg(long, value_enum, default_value = "oblique")]
    pub view: View,
    /// Colours of the background.
    #[arg(long, value_enum, default_value = "light")]
    pub theme: ThemeName,
    /// Width of one drawing, pixels (100 to 4000); the whole picture has at most 100 megapixels.
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u16).range(100..=4000))]
    pub width: Option<u16>,
}

/// A field that can be shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum ShownField {
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
    pub fn camera(self) -> Camera {
        match self {
            Self::Oblique => Camera::new(24.0, 17.0),
            Self::Side => Camera::new(0.0, 0.0),
            Self::Top => Camera::new(0.0, 89.9),
        }
    }
}

impl ShownField {
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

/// A state ready to draw.
pub struct DrawnState {
    pub body: DrawnBody,
    pub plate: Option<Plate>,
    pub blocks: Vec<Block>,
    pub force_n: f64,
    pub outside: bool,
    pub title: String,
}

impl DrawnState {
    fn full_title(&self) -> String {
        format!("{}{}", self.title, if self.outside { " (extrapolated)" } else { "" })
    }

    fn panel(&self, range: [f32; 2], with_title: bool) -> Panel<'_> {
        Panel {
            scene: Scene { body: &self.body, plate: self.plate, blocks: &self.blocks, range },
            title: if with_title { self.full_title() } else { String::new() },
            note: if self.force_n > 0.0 { format!("{:.3} N", self.force_n) } else { String::new() },
        }
    }
}

/// Shots side by side under a heading.
pub struct Group {
    pub heading: String,
    pub states: Vec<DrawnState>,
}

impl Group {
    /// One state without a heading.
    pub fn alone(state: DrawnState) -> Self {
        Self { heading: String::new(), states: vec![state] }
    }

    fn row(&self, range: [f32; 2], with_titles: bool) -> Row<'_> {
        let panels = self.states.iter().map(|state| state.panel(range, with_titles)).collect();
        Row { heading: self.heading.clone(), panels }
    }
}

/// The scale of all states and the largest value. Stress peaks at single nodes of sharp corners; the scale ends where
/// 99.5 % of the visible nodes lie, so that the rest of the body is not all one colour, and the label says how far it goes.
fn colour_scale(range: Option<[f32; 2]>, groups: &[Group]) -> (Scale, f32) {
    let visible = |state: &DrawnState| {
        let mut seen = state.body.facets.as_flattened().to_vec();
        seen.sort_unstable();
        seen.dedup();
        seen.into_iter().map(|node| state.body.values[node as usize]).collect::<Vec<f32>>()
    };
    let states = groups.iter().flat_map(|group| &group.states);
    let mut values: Vec<f32> = states.flat_map(visible).filter(|value| value.is_finite()).collect();
    values.sort_unstable_by(f32::total_cmp);
    let largest = values.last().copied().unwrap_or(0.0);
    let most = values.get(values.len() * 995 / 1000).copied().unwrap_or(0.0);
    let scale = range.map_or_else(|| Scale::rounded([0.0, most], 5), |range| Scale::new(range, 5));
    (scale, largest)
}

/// Arranges states with one colour scale for all. Without a headline there is one state, whose title is the picture's.
pub fn draw(look: &Look, groups: &[Group], headline: Option<&str>, caption: String) -> Result<Canvas> {
    let (scale, largest) = colour_scale(look.range, groups);
    let single = headline.is_none();
    let panel_px = usize::from(look.width.unwrap_or(if single { 1100 } else { 420 }));
    let sheet = Sheet {
        title: headline.map_or_else(|| groups[0].states[0].full_title(), str::to_owned),
        caption,
        rows: groups.iter().map(|group| group.row(scale.range, !single)).collect(),
        bar_label: format!("{}, largest {largest:.2}", look.field.label()),
        map: ColourMap::stress(),
        camera: look.view.camera(),
        panel_px,
        text_px: if single { (panel_px as f32 / TEXT_SHARE).min(22.0) } else { 21.0 },
        theme: look.theme.colours(),
        scale,
    };
    sheet.draw()
}

fn parse_range(text: &str) -> Result<[f32; 2], String> {
    let ends: Option<[f32; 2]> = text
        .split_once(':')
        .and_then(|(low, high)| Some([low.trim().parse().ok()?, high.trim().parse().ok()?]))
        .filter(|[low, high]: &[f32; 2]| low < high && high.is_finite() && low.is_finite());
    ends.ok_or_else(|| format!("expected LOW:HIGH with LOW < HIGH, such as 0:0.5, found {text:?}"))
}

#[cfg(test)]
#[path = "../tests/unit/states.rs"]
mod tests;
