//! One state as a picture: the coloured body, the plate under it, light and shadow.

use super::camera::{Camera, Vec3, Window, dot, unit};
use super::canvas::Canvas;
use super::colour::{ColourMap, decode};
use super::raster::{BAND_ROWS, Hit, Raster};
use super::shadow::Shadow;
use super::skin::{Corner, DrawnBody};
use super::theme::Theme;

/// Thickness of the plate as drawn, mm.
const PLATE_THICKNESS_MM: f32 = 2.0;
/// Distance of the lines on the plate, mm.
const GRID_MM: f32 = 10.0;

/// The rigid plate: the plane `y = -gap_mm` over a rectangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plate {
    /// From the underside of the undeformed base to the plate, mm.
    pub gap_mm: f32,
    /// Extent along the actuator, mm.
    pub x_mm: [f32; 2],
    /// Extent across the actuator, mm.
    pub z_mm: [f32; 2],
}

/// A rigid block with edges along the axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Block {
    /// Lower corner, mm.
    pub min_mm: Vec3,
    /// Upper corner, mm.
    pub max_mm: Vec3,
}

impl Block {
    /// Two facets for each of the six faces.
    fn corners(&self) -> Vec<[Corner; 3]> {
        let ends = [self.min_mm, self.max_mm];
        let mut corners = Vec::with_capacity(12);
        for axis in 0..3 {
            for (side, sign) in [(0, -1.0), (1, 1.0)] {
                let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                let mut normal = [0.0; 3];
                normal[axis] = sign;
                let corner = |a: usize, b: usize| {
                    let mut position = [0.0; 3];
                    (position[axis], position[u], position[v]) = (ends[side][axis], ends[a][u], ends[b][v]);
                    Corner { position, normal, value: 0.0 }
                };
                corners.push([corner(0, 0), corner(1, 0), corner(1, 1)]);
                corners.push([corner(0, 0), corner(1, 1), corner(0, 1)]);
            }
        }
        corners
    }
}

/// Content of one panel.
pub struct Scene<'a> {
    /// The deformed body with its values.
    pub body: &'a DrawnBody,
    /// The plate, if there is one.
    pub plate: Option<Plate>,
    /// Rigid blocks.
    pub blocks: &'a [Block],
    /// Values at the ends of the colour scale.
    pub range: [f32; 2],
}

impl Scene<'_> {
    /// Points that must be inside the window: all nodes and the plate's corners.
    pub fn extent(&self) -> impl Iterator<Item = Vec3> + '_ {
        let plate = self.plate.into_iter().flat_map(|plate| {
            let [x, z] = [plate.x_mm, plate.z_mm];
            [0, 1, 2, 3].map(|k| [x[k & 1], -plate.gap_mm - PLATE_THICKNESS_MM, z[k >> 1]])
        });
        let blocks = self.blocks.iter().flat_map(|block| [block.min_mm, block.max_mm]);
        self.body.nodes_mm.iter().copied().chain(plate).chain(blocks)
    }

    /// Draws the scene.
    pub fn draw(
        &self,
        camera: Camera,
        window: Window,
        pixels: [usize; 2],
        map: &ColourMap,
        theme: &Theme,
    ) -> Canvas {
        let page = theme.panel.map(decode);
        let base = theme.plate.map(decode);
        let light = Light::of(&camera);
        let plate = self.plate.map(|plate| {
            (plate, plate.corners(), Shadow::cast(self.body, -plate.gap_mm, plate.x_mm, plate.z_mm))
        });
        let blocks: Vec<[Corner; 3]> = self.blocks.iter().flat_map(Block::corners).collect();
        let body = self.body.corners();
        let [low, high] = self.range;
        let scale = if high > low { 1.0 / (high - low) } else { 0.0 };
        let mut canvas = Canvas::new(pixels[0], pixels[1], theme.panel);
        for top in (0..pixels[1]).step_by(BAND_ROWS) {
            let mut raster = Raster::new(camera, window, pixels, top, |_| page);
            if let Some((plate, corners, shadow)) = &plate {
                raster.draw(corners, true, |hit| plate.shade(hit, base, shadow, &light));
            }
            raster.draw(&blocks, true, |hit| light.on(base, hit.normal));
            raster.draw(&body, true, |hit| light.on(map.linear((hit.value - low) * scale), hit.normal));
            raster.finish(&mut canvas);
        }
        canvas
    }
}

impl Plate {
    /// A flat box with its top face at `y = -gap_mm`; the value is 1 on the top face, 0 elsewhere.
    fn corners(&self) -> Vec<[Corner; 3]> {
        let y = [-self.gap_mm - PLATE_THICKNESS_MM, -self.gap_mm];
        let (x, z) = (self.x_mm, self.z_mm);
        let quad = |points: [Vec3; 4], normal: Vec3| {
            let value = normal[1].max(0.0);
            let corner = |k: usize| Corner { position: points[k], normal, value };
            [[corner(0), corner(1), corner(2)], [corner(0), corner(2), corner(3)]]
        };
        let top = [[x[0], y[1], z[1]], [x[1], y[1], z[1]], [x[1], y[1], z[0]], [x[0], y[1], z[0]]];
        let mut corners = quad(top, [0.0, 1.0, 0.0]).to_vec();
        for k in 0..2 {
            let side = if k == 0 { -1.0 } else { 1.0 };
            let front = [[x[0], y[0], z[k]], [x[1], y[0], z[k]], [x[1], y[1], z[k]], [x[0], y[1], z[k]]];
            corners.extend(quad(front, [0.0, 0.0, side]));
            let end = [[x[k], y[0], z[0]], [x[k], y[0], z[1]], [x[k], y[1], z[1]], [x[k], y[1], z[0]]];
            corners.extend(quad(end, [side, 0.0, 0.0]));
        }
        corners
    }

    fn shade(&self, hit: &Hit, base: [f32; 3], shadow: &Shadow, light: &Light) -> [f32; 3] {
        if hit.value < 0.5 {
            return light.on(base.map(|v| 0.75 * v), hit.normal);
        }
        let line = |v: f32| (v / GRID_MM - (v / GRID_MM).round()).abs() * GRID_MM < 0.12;
        let grid = if line(hit.position[0]) || line(hit.position[2]) { 0.82 } else { 1.0 };
        base.map(|v| v * grid * shadow.at(hit.position[0], hit.position[2]))
    }
}

/// One lamp over the viewer's left shoulder, a weaker one from the right, and light from everywhere.
struct Light {
    key: Vec3,
    fill: Vec3,
    half: Vec3,
}

impl Light {
    fn of(camera: &Camera) -> Self {
        let towards = |right: f32, up: f32, near: f32| -> Vec3 {
            unit(std::array::from_fn(|k| {
                right * camera.right[k] + up * camera.up[k] + near * camera.toward[k]
            }))
        };
        let key = towards(-0.45, 0.75, 0.6);
        Self {
            key,
            fill: towards(0.8, 0.1, 0.6),
            half: unit(std::array::from_fn(|k| key[k] + camera.toward[k])),
        }
    }

    /// A linear colour under this light; at most 10 % is added, so colours stay readable on the scale.
    fn on(&self, colour: [f32; 3], normal: Vec3) -> [f32; 3] {
        let diffuse = 0.56 + 0.42 * dot(normal, self.key).max(0.0) + 0.14 * dot(normal, self.fill).max(0.0);
        let gloss = 0.06 * dot(normal, self.half).max(0.0).powi(24);
        colour.map(|v| v * diffuse + gloss)
    }
}

#[cfg(test)]
#[path = "../tests/unit/scene.rs"]
mod tests;
