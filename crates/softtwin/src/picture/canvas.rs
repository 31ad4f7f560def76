//! A picture in memory: opaque RGB pixels, filled rectangles, blended text, PNG files.

use crate::files;
use anyhow::{Context, Result};
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
        files::save(path, &png_bytes(size, self.pixels.as_flattened(), Compression::High)?)
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
mod tests {
    use super::*;

    #[test]
    fn what_is_drawn_outside_is_cut_off() {
        let mut canvas = Canvas::new(4, 3, [0; 3]);
        canvas.fill(3, 2, 10, 10, [9; 3]);
        canvas.blend(-1, 0, [255; 3], 1.0);
        canvas.blend(0, 7, [255; 3], 1.0);
        canvas.paste(2, 1, &Canvas::new(9, 1, [5; 3]));
        let expected =
            [[0; 3], [0; 3], [0; 3], [0; 3], [0; 3], [0; 3], [5; 3], [5; 3], [0; 3], [0; 3], [0; 3], [9; 3]];
        assert_eq!(canvas.pixels, expected);
    }

    #[test]
    fn blending_is_a_weighted_mean() {
        let mut canvas = Canvas::new(1, 1, [100, 0, 200]);
        canvas.blend(0, 0, [200, 100, 0], 0.25);
        assert_eq!(canvas.pixels[0], [125, 25, 150]);
    }

    #[test]
    fn a_written_png_reads_back_the_same() {
        let mut canvas = Canvas::new(5, 4, [1, 2, 3]);
        canvas.fill(1, 1, 2, 2, [250, 128, 0]);
        let path = std::env::temp_dir().join(format!("softtwin-canvas-{}.png", std::process::id()));
        canvas.write_png(&path).expect("the temporary folder is writable");
        let decoder =
            png::Decoder::new(std::io::BufReader::new(std::fs::File::open(&path).expect("just written")));
        let mut reader = decoder.read_info().expect("a PNG");
        let mut bytes = vec![0; reader.output_buffer_size().expect("small")];
        reader.next_frame(&mut bytes).expect("one frame");
        assert_eq!(bytes, canvas.pixels.as_flattened());
        std::fs::remove_file(path).expect("removable");
    }
}
