//! The rasteriser: triangles to pixels with a depth buffer, colours and normals interpolated per pixel.
//!
//! Everything is drawn at [`SAMPLES`] times the size in each direction and averaged in linear light, which smooths
//! edges. `O(pixels covered)` a triangle. A picture is drawn in bands of [`BAND_ROWS`] rows, so that the sub-pixels, 153
//! bytes a pixel, never take more than some megabytes.

use super::camera::{Camera, Vec3, Window, dot};
use super::canvas::Canvas;
use super::colour::encode;
use super::skin::Corner;
use std::iter::repeat_n;
use std::ops::Range;

/// Sub-pixels along each side of a pixel.
pub const SAMPLES: usize = 3;
/// Rows of pixels of a band.
pub const BAND_ROWS: usize = 64;
/// A step in depth (mm) between neighbours that is drawn as an outline.
const OUTLINE_MM: f32 = 2.0;
/// How much darker an outline is.
const OUTLINE_SHADE: f32 = 0.45;

/// A triangle's contribution at one sub-pixel.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// Where, mm.
    pub position: Vec3,
    /// Surface normal, turned to the eye, length one.
    pub normal: Vec3,
    /// The interpolated value.
    pub value: f32,
}

/// Sub-pixels of one band of a picture.
pub struct Raster {
    camera: Camera,
    window: Window,
    /// Size of the whole picture, in sub-pixels.
    width: usize,
    height: usize,
    /// The rows of sub-pixels that are drawn: the band, and one more below it for the outlines.
    rows: Range<usize>,
    depth: Vec<f32>,
    colour: Vec<[f32; 3]>,
    outlined: Vec<bool>,
}

impl Raster {
    /// An empty band of a picture of `[width, height]` pixels, from the pixel row `top` on. `background` gives the linear
    /// colour for a height 0 (top) ..= 1.
    pub fn new(
        camera: Camera,
        window: Window,
        pixels: [usize; 2],
        top: usize,
        background: impl Fn(f32) -> [f32; 3],
    ) -> Self {
        let (width, height) = (pixels[0] * SAMPLES, pixels[1] * SAMPLES);
        let rows = top * SAMPLES..((top + BAND_ROWS) * SAMPLES + 1).min(height);
        let colour =
            rows.clone().flat_map(|y| repeat_n(background(y as f32 / height as f32), width)).collect();
        let count = width * rows.len();
        Self {
            camera,
            window,
            width,
            height,
            rows,
            depth: vec![f32::NEG_INFINITY; count],
            colour,
            outlined: vec![false; count],
        }
    }

    /// Draws triangles; `shade` gives the linear colour of a hit. Triangles with a coordinate that is not a number are
    /// left out. With `outlined`, steps in depth against anything else are drawn as dark lines by [`Raster::finish`].
    pub fn draw(&mut self, triangles: &[[Corner; 3]], outlined: bool, shade: impl Fn(&Hit) -> [f32; 3]) {
        for triangle in triangles {
            let pixels = triangle.map(|corner| self.to_pixels(corner.position));
            if pixels.iter().flatten().all(|v| v.is_finite()) {
                self.fill(triangle, pixels, outlined, &shade);
            }
        }
    }

    /// Sub-pixel coordinates (right, down) and nearness to the eye.
    fn to_pixels(&self, point: Vec3) -> Vec3 {
        let p = self.camera.project(point);
        let scale = SAMPLES as f32 / self.window.mm_per_px;
        [
            0.5 * self.width as f32 + (p[0] - self.window.centre_mm[0]) * scale,
            0.5 * self.height as f32 - (p[1] - self.window.centre_mm[1]) * scale,
            p[2],
        ]
    }

    fn fill(
        &mut self,
        corners: &[Corner; 3],
        at: [Vec3; 3],
        outlined: bool,
        shade: &impl Fn(&Hit) -> [f32; 3],
    ) {
        let [a, b, c] = at;
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        if area.abs() < 1e-9 {
            return;
        }
        let span = |k: usize, limit: usize| {
            let low = a[k].min(b[k]).min(c[k]).floor().clamp(0.0, limit as f32) as usize;
            let high = (a[k].max(b[k]).max(c[k]).ceil() + 1.0).clamp(0.0, limit as f32) as usize;
            low..high
        };
        let rows = span(1, self.height);
        for y in rows.start.max(self.rows.start)..rows.end.min(self.rows.end) {
            for x in span(0, self.width) {
                let (px, py) = (x as f32 + 0.5, y as f32 + 0.5);
                let wa = ((b[0] - px) * (c[1] - py) - (b[1] - py) * (c[0] - px)) / area;
                let wb = ((c[0] - px) * (a[1] - py) - (c[1] - py) * (a[0] - px)) / area;
                let weights = [wa, wb, 1.0 - wa - wb];
                let index = (y - self.rows.start) * self.width + x;
                let depth = weights[0] * a[2] + weights[1] * b[2] + weights[2] * c[2];
                if weights.iter().all(|w| *w >= -1e-6) && depth > self.depth[index] {
                    self.depth[index] = depth;
                    self.outlined[index] = outlined;
                    self.colour[index] = shade(&self.hit(corners, weights));
                }
            }
        }
    }

    fn hit(&self, corners: &[Corner; 3], w: [f32; 3]) -> Hit {
        let mix = |get: fn(&Corner) -> Vec3| -> Vec3 {
            let [a, b, c] = [get(&corners[0]), get(&corners[1]), get(&corners[2])];
            std::array::from_fn(|k| w[0] * a[k] + w[1] * b[k] + w[2] * c[k])
        };
        let normal = super::camera::unit(mix(|corner| corner.normal));
        let sign = if dot(normal, self.camera.toward) < 0.0 { -1.0 } else { 1.0 };
        Hit {
            position: mix(|corner| corner.position),
            normal: normal.map(|v| sign * v),
            value: w[0] * corners[0].value + w[1] * corners[1].value + w[2] * corners[2].value,
        }
    }

    /// True where the surface ends: a right or lower neighbour is farther away or nearer by a visible step. `y` counts from
    /// the band's first row.
    fn is_outline(&self, x: usize, y: usize) -> bool {
        let index = y * self.width + x;
        let step = |other: usize| {
            let (near, far) =
                (self.depth[index].max(self.depth[other]), self.depth[index].min(self.depth[other]));
            (self.outlined[index] || self.outlined[other])
                && near > f32::NEG_INFINITY
                && near - far > OUTLINE_MM
        };
        (x + 1 < self.width && step(index + 1)) || (y + 1 < self.rows.len() && step(index + self.width))
    }

    /// Averages the sub-pixels into the band's pixels of the picture.
    pub fn finish(&self, canvas: &mut Canvas) {
        let top = self.rows.start / SAMPLES;
        for y in top..(top + BAND_ROWS).min(canvas.height) {
            for x in 0..canvas.width {
                canvas.pixels[y * canvas.width + x] =
                    self.average(x * SAMPLES, (y - top) * SAMPLES).map(encode);
            }
        }
    }

    fn average(&self, left: usize, top: usize) -> [f32; 3] {
        let mut sum = [0.0; 3];
        for y in top..top + SAMPLES {
            for x in left..left + SAMPLES {
                let light = if self.is_outline(x, y) { OUTLINE_SHADE } else { 1.0 };
                let colour = self.colour[y * self.width + x];
                sum = std::array::from_fn(|k| sum[k] + light * colour[k]);
            }
        }
        sum.map(|v| v / (SAMPLES * SAMPLES) as f32)
    }
}

#[cfg(test)]
#[path = "../tests/unit/raster.rs"]
mod tests;
