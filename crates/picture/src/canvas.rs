//! A picture in memory: opaque RGB pixels, filled rectangles, blended text, PNG files.

use anyhow::{Context, Result};
use formats::file;
pub use png::Compression;
use std::path::Path;

/// An sRGB colour.
pub type Rgb = [u8; 3];

/// Opaque pixels, row by row from the top left corner.
#[derive(Clone, Debug, PartialEq)]
pub struct Canvas {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// `width x height` colours.
    pub pixels: Vec<Rgb>,
}

impl Canvas {
    /// A canvas of one colour.
    pub fn new(width: usize, height: usize, colour: Rgb) -> Self {
        Self { width, height, pixels: vec![colour; width * height] }
    }

    /// Mixes `colour` into one pixel with `cover` in 0 ..= 1; outside the canvas nothing happens.
    pub fn blend(&mut self, x: i64, y: i64, colour: Rgb, cover: f32) {
        let inside = x >= 0 && y >= 0 && (x as usize) < self.width && (y as usize) < self.height;
        if inside {
            let pixel = &mut self.pixels[y as usize * self.width + x as usize];
            for (to, from) in pixel.iter_mut().zip(colour) {
                *to = (f32::from(*to) + (f32::from(from) - f32::from(*to)) * cover).round() as u8;
            }
        }
    }

    /// Fills a rectangle; parts outside the canvas are cut off.
    pub fn fill(&mut self, x: usize, y: usize, width: usize, height: usize, colour: Rgb) {
        let right = (x + width).min(self.width);
        for row in y..(y + height).min(self.height) {
            for pixel in &mut self.pixels[row * self.width + x.min(right)..row * self.width + right] {
                *pixel = colour;
            }
        }
    }

    /// Copies another canvas to a place; parts outside are cut off.
    pub fn paste(&mut self, x: usize, y: usize, other: &Self) {
        let width = other.width.min(self.width.saturating_sub(x));
        for row in 0..other.height.min(self.height.saturating_sub(y)) {
            let to = (y + row) * self.width + x;
            self.pixels[to..to + width]
                .copy_from_slice(&other.pixels[row * other.width..row * other.width + width]);
        }
    }

    /// Writes an 8-bit RGB PNG. An existing file is replaced as a whole.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_png(&self, path: &Path) -> Result<()> {
        let size = [self.width as u32, self.height as u32];
        Ok(file::replace(path, &png_bytes(size, self.pixels.as_flattened(), Compression::High)?)?)
    }
}

/// An 8-bit RGB PNG of `[width, height]` pixels.
///
/// # Errors
/// A size that no PNG has, or pixels that do not fill it.
pub fn png_bytes([width, height]: [u32; 2], rgb: &[u8], compression: Compression) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(compression);
    encoder
        .write_header()
        .and_then(|mut writer| writer.write_image_data(rgb))
        .context("encoding the picture")?;
    Ok(bytes)
}

#[cfg(test)]
#[path = "../tests/unit/canvas.rs"]
mod tests;
