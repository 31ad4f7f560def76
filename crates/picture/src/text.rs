//! Text in pictures: DejaVu Sans, which the program carries with it, so that pictures look the same on every machine.

use super::canvas::{Canvas, Rgb};
use ab_glyph::{Font, FontRef, PxScale, ScaleFont};
use anyhow::{Context, Result};

/// The regular and the bold face.
pub struct Fonts {
    regular: FontRef<'static>,
    bold: FontRef<'static>,
}

/// How a line of text stands to the point it is drawn at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Align {
    /// The point is the left end.
    Left,
    /// The point is the middle.
    Centre,
    /// The point is the right end.
    Right,
}

/// Size, weight, colour and alignment of a line.
#[derive(Clone, Copy, Debug)]
pub struct Style {
    /// Height of a line in pixels.
    pub size_px: f32,
    /// Bold face.
    pub bold: bool,
    pub colour: Rgb,
    pub align: Align,
}

impl Fonts {
    /// Reads the embedded faces.
    ///
    /// # Errors
    /// When the embedded font data is not a font, which is a fault of the build.
    pub fn embedded() -> Result<Self> {
        let read = |bytes| FontRef::try_from_slice(bytes).context("the embedded font cannot be read");
        Ok(Self { regular: read(dejavu::sans::regular())?, bold: read(dejavu::sans::bold())? })
    }

    fn face(&self, bold: bool) -> &FontRef<'static> {
        if bold { &self.bold } else { &self.regular }
    }

    /// Width of a line in pixels, with kerning.
    pub fn width_px(&self, text: &str, size_px: f32, bold: bool) -> f32 {
        self.layout(text, size_px, bold).1
    }

    /// Glyphs with their pen positions, and the width of the line.
    fn layout(&self, text: &str, size_px: f32, bold: bool) -> (Vec<(ab_glyph::GlyphId, f32)>, f32) {
        let font = self.face(bold).as_scaled(PxScale::from(size_px));
        let mut pen = 0.0;
        let mut last = None;
        let mut glyphs = Vec::new();
        for character in text.chars() {
            let id = font.glyph_id(character);
            if let Some(before) = last {
                pen += font.kern(before, id);
            }
            glyphs.push((id, pen));
            pen += font.h_advance(id);
            last = Some(id);
        }
        (glyphs, pen)
    }

    /// Draws one line; `y` is the top of the line, `x` what [`Align`] says.
    pub fn draw(&self, canvas: &mut Canvas, x: f32, y: f32, text: &str, style: Style) {
        let scale = PxScale::from(style.size_px);
        let font = self.face(style.bold);
        let (glyphs, width) = self.layout(text, style.size_px, style.bold);
        let left = match style.align {
            Align::Left => x,
            Align::Centre => x - 0.5 * width,
            Align::Right => x - width,
        };
        let baseline = y + font.as_scaled(scale).ascent();
        for (id, pen) in glyphs {
            let glyph = id.with_scale_and_position(scale, ab_glyph::point(left + pen, baseline));
            if let Some(outline) = font.outline_glyph(glyph) {
                let corner = outline.px_bounds().min;
                outline.draw(|dx, dy, cover| {
                    canvas.blend(
                        corner.x as i64 + i64::from(dx),
                        corner.y as i64 + i64::from(dy),
                        style.colour,
                        cover.min(1.0),
                    );
                });
            }
        }
    }
}

#[cfg(test)]
#[path = "../tests/unit/text.rs"]
mod tests;
