//! The soft shadow of a body on the plate: it shows how far the actuator hovers above it.

use super::skin::DrawnBody;

/// Cells per millimetre of the height map.
const CELLS_PER_MM: f32 = 1.0;
/// The darkest shadow takes away this fraction of the light.
const DEPTH: f32 = 0.55;
/// Height (mm) over which the shadow fades to 1/e.
const FADE_MM: f32 = 18.0;

/// Light reaching the plate from straight above, over a rectangle of x and z.
pub struct Shadow {
    origin_mm: [f32; 2],
    cells: [usize; 2],
    light: Vec<f32>,
}

impl Shadow {
    /// Casts the shadow of a body on the plane `y = plate_y_mm` over the rectangle `x_mm`, `z_mm`.
    pub fn cast(body: &DrawnBody, plate_y_mm: f32, x_mm: [f32; 2], z_mm: [f32; 2]) -> Self {
        let cells = [x_mm, z_mm].map(|range| ((range[1] - range[0]) * CELLS_PER_MM).ceil().max(1.0) as usize);
        let mut shadow = Self { origin_mm: [x_mm[0], z_mm[0]], cells, light: vec![1.0; cells[0] * cells[1]] };
        for facet in &body.facets {
            let [a, b, c] = facet.map(|node| body.nodes_mm[node as usize]);
            for (u, v) in [(1.0 / 3.0, 1.0 / 3.0), (0.6, 0.2), (0.2, 0.6), (0.2, 0.2)] {
                let mixed = |k: usize| a[k] * (1.0 - u - v) + b[k] * u + c[k] * v;
                shadow.darken(mixed(0), mixed(2), mixed(1) - plate_y_mm);
            }
        }
        shadow.blur();
        shadow
    }

    fn darken(&mut self, x: f32, z: f32, height_mm: f32) {
        let place = [x, z].map(f32::floor);
        let cell: [f32; 2] = std::array::from_fn(|k| ((place[k] - self.origin_mm[k]) * CELLS_PER_MM).floor());
        if (0..2).all(|k| cell[k] >= 0.0 && cell[k] < self.cells[k] as f32) {
            let light = 1.0 - DEPTH * (-height_mm.max(0.0) / FADE_MM).exp();
            let cell = &mut self.light[cell[1] as usize * self.cells[0] + cell[0] as usize];
            *cell = cell.min(light);
        }
    }

    /// Three passes of a 3 x 3 mean.
    fn blur(&mut self) {
        for _ in 0..3 {
            let old = self.light.clone();
            for z in 0..self.cells[1] {
                for x in 0..self.cells[0] {
                    let (mut sum, mut count) = (0.0, 0.0);
                    for j in z.saturating_sub(1)..(z + 2).min(self.cells[1]) {
                        for i in x.saturating_sub(1)..(x + 2).min(self.cells[0]) {
                            sum += old[j * self.cells[0] + i];
                            count += 1.0;
                        }
                    }
                    self.light[z * self.cells[0] + x] = sum / count;
                }
            }
        }
    }

    /// The fraction of light at a point of the plate, between cells bilinear.
    pub fn at(&self, x: f32, z: f32) -> f32 {
        let place: [f32; 2] = std::array::from_fn(|k| {
            (([x, z][k] - self.origin_mm[k]) * CELLS_PER_MM - 0.5).clamp(0.0, (self.cells[k] - 1) as f32)
        });
        let cell = place.map(|v| v as usize);
        let next: [usize; 2] = std::array::from_fn(|k| (cell[k] + 1).min(self.cells[k] - 1));
        let [u, v] = [place[0] - cell[0] as f32, place[1] - cell[1] as f32];
        let light = |i: usize, j: usize| self.light[j * self.cells[0] + i];
        let row = |j: usize| light(cell[0], j) * (1.0 - u) + light(next[0], j) * u;
        row(cell[1]) * (1.0 - v) + row(next[1]) * v
    }
}

#[cfg(test)]
#[path = "../tests/unit/shadow.rs"]
mod tests;
