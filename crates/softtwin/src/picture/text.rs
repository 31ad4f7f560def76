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
    /// Colour.
    pub colour: Rgb,
    /// Alignment.
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
mod tests {
    use super::*;

    const STYLE: Style = Style { size_px: 20.0, bold: false, colour: [0; 3], align: Align::Left };

    fn inked_columns(align: Align) -> (usize, usize) {
        let fonts = Fonts::embedded().expect("embedded");
        let mut canvas = Canvas::new(200, 30, [255; 3]);
        fonts.draw(&mut canvas, 100.0, 4.0, "0.46 MPa", Style { align, ..STYLE });
        let dark = |x: &usize| (0..30).any(|y| canvas.pixels[y * 200 + x][0] < 128);
        let columns: Vec<usize> = (0..200).filter(dark).collect();
        (columns[0], columns[columns.len() - 1])
    }

    #[test]
    fn alignment_puts_the_ink_where_it_says() {
        let (left, _) = inked_columns(Align::Left);
        assert!((100..106).contains(&left), "{left}");
        let (_, right) = inked_columns(Align::Right);
        assert!((94..=100).contains(&right), "{right}");
        let (left, right) = inked_columns(Align::Centre);
        assert!((left + right).abs_diff(200) <= 6, "{left} {right}");
    }

    #[test]
    fn every_character_of_our_captions_has_a_glyph_that_leaves_ink() {
        let fonts = Fonts::embedded().expect("embedded");
        for character in "PΔHσ·×°±≤≥–µ%φ".chars() {
            let mut canvas = Canvas::new(40, 40, [255; 3]);
            assert_ne!(fonts.regular.glyph_id(character).0, 0, "no glyph for {character}");
            fonts.draw(&mut canvas, 4.0, 4.0, &character.to_string(), STYLE);
            assert!(canvas.pixels.iter().any(|p| p[0] < 128), "{character} leaves no ink");
        }
    }

    #[test]
    fn longer_text_is_wider_and_width_grows_with_size() {
        let fonts = Fonts::embedded().expect("embedded");
        let short = fonts.width_px("gap", 20.0, false);
        assert!(fonts.width_px("gap 40 mm", 20.0, false) > short);
        assert!((fonts.width_px("gap", 40.0, false) - 2.0 * short).abs() < 0.5);
    }
}
