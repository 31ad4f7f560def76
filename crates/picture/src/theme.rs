//! Colours of pictures for light and for dark pages.

use super::canvas::Rgb;

/// Colours of everything that is not data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Theme {
    /// Around the panels.
    pub page: Rgb,
    /// Behind a scene.
    pub panel: Rgb,
    /// Titles and numbers.
    pub ink: Rgb,
    /// Secondary text and lines.
    pub faint: Rgb,
    pub plate: Rgb,
}

impl Theme {
    /// For light pages.
    pub const LIGHT: Self = Self {
        page: [255, 255, 255],
        panel: [246, 247, 249],
        ink: [31, 35, 40],
        faint: [101, 109, 118],
        plate: [206, 211, 218],
    };
    /// For dark pages.
    pub const DARK: Self = Self {
        page: [13, 17, 23],
        panel: [22, 27, 34],
        ink: [230, 237, 243],
        faint: [145, 152, 161],
        plate: [72, 80, 92],
    };
}

/// Which theme, as typed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum ThemeName {
    /// Dark ink on a light page.
    Light,
    /// Light ink on a dark page.
    Dark,
}

impl ThemeName {
    pub fn colours(self) -> Theme {
        match self {
            Self::Light => Theme::LIGHT,
            Self::Dark => Theme::DARK,
        }
    }
}
