//! Tests of `src/raster.rs`.

use super::*;

const SIDE: usize = 20;

fn raster() -> Raster {
    let window = Window { centre_mm: [0.0; 2], mm_per_px: 1.0 };
    Raster::new(Camera::new(0.0, 0.0), window, [SIDE; 2], 0, |_| [0.0; 3])
}

fn finished(raster: &Raster) -> Canvas {
    let mut canvas = Canvas::new(SIDE, SIDE, [0; 3]);
    raster.finish(&mut canvas);
    canvas
}

/// A triangle with corners (-8, -8), (8, -8), (-8, 8) at the given depth.
fn triangle(z: f32, values: [f32; 3]) -> [Corner; 3] {
    let corner = |x, y, value| Corner { position: [x, y, z], normal: [0.0, 0.0, 1.0], value };
    [corner(-8.0, -8.0, values[0]), corner(8.0, -8.0, values[1]), corner(-8.0, 8.0, values[2])]
}

#[test]
fn values_are_interpolated_linearly_per_pixel() {
    let mut raster = raster();
    raster.draw(&[triangle(0.0, [0.0, 1.6, 0.0])], false, |hit| [hit.value; 3]);
    let canvas = finished(&raster);
    // The pixel (6, 15) has its centre at x = -3.5, y = -5.5, so the value is 0.1 (x + 8).
    assert_eq!(canvas.pixels[15 * SIDE + 6][0], encode(0.45));
}

#[test]
fn nearer_triangle_is_drawn_in_either_order() {
    let (near, far) = (triangle(5.0, [1.0; 3]), triangle(-5.0, [0.25; 3]));
    let pictures = [[near, far], [far, near]].map(|both| {
        let mut raster = raster();
        raster.draw(&both, false, |hit| [hit.value; 3]);
        finished(&raster)
    });
    assert_eq!(pictures[0], pictures[1]);
    assert_eq!(pictures[0].pixels[14 * SIDE + 5], [255; 3]);
}

#[test]
fn covered_area_equals_the_triangle() {
    let mut raster = raster();
    raster.draw(&[triangle(0.0, [1.0; 3])], false, |_| [1.0; 3]);
    let covered = raster.colour.iter().filter(|c| c[0] > 0.5).count() as f32 / (SAMPLES * SAMPLES) as f32;
    assert!((covered - 128.0).abs() < 3.0, "{covered} of 128 px");
}

#[test]
fn invalid_or_outside_triangles_draw_nothing() {
    let mut raster = raster();
    let mut broken = triangle(0.0, [1.0; 3]);
    broken[0].position[1] = f32::NAN;
    let outside = triangle(0.0, [1.0; 3]).map(|c| Corner { position: [c.position[0] + 1e6, 0.0, 0.0], ..c });
    raster.draw(&[broken, outside], true, |_| [1.0; 3]);
    assert!(finished(&raster).pixels.iter().all(|p| *p == [0; 3]));
}
