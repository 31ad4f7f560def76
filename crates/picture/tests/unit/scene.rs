//! Tests of `src/scene.rs`.

use super::*;

/// Bands must not be seen: outlines and colours continue across their edges.
#[test]
fn picture_of_several_bands_equals_one_band_moved() {
    let nodes_mm = vec![[20.0, 5.0, 0.0], [100.0, 5.0, 0.0], [60.0, 60.0, 30.0]];
    let body = DrawnBody { nodes_mm, facets: vec![[0, 1, 2]], values: vec![0.0, 0.5, 1.0] };
    let scene = Scene { body: &body, plate: None, blocks: &[], range: [0.0, 1.0] };
    let camera = Camera::new(0.0, 0.0);
    let draw = |centre_px: f32| {
        let window = Window { centre_mm: [60.0, 30.0 + centre_px], mm_per_px: 1.0 };
        scene.draw(camera, window, [100, 3 * BAND_ROWS], &ColourMap::stress(), &Theme::LIGHT)
    };
    let moved = BAND_ROWS / 2;
    let (still, shifted) = (draw(0.0), draw(moved as f32));
    let rows =
        |canvas: &Canvas, from: usize| canvas.pixels[100 * from..100 * (from + 2 * BAND_ROWS)].to_vec();
    assert_eq!(rows(&still, 0), rows(&shifted, moved));
    assert!(still.pixels.iter().any(|pixel| *pixel != Theme::LIGHT.panel));
}

#[test]
fn body_and_plate_show_their_colours() {
    let nodes_mm = vec![[20.0, 5.0, 0.0], [100.0, 5.0, 0.0], [60.0, 5.0, 30.0]];
    let body = DrawnBody { nodes_mm, facets: vec![[0, 1, 2]], values: vec![1.0; 3] };
    let plate = Plate { gap_mm: 0.0, x_mm: [0.0, 120.0], z_mm: [-9.0, 41.0] };
    let scene = Scene { body: &body, plate: Some(plate), blocks: &[], range: [0.0, 1.0] };
    let camera = Camera::new(0.0, 60.0);
    let window = Window::around(&camera, scene.extent(), [120, 60], 0.05);
    let canvas = scene.draw(camera, window, [120, 60], &ColourMap::stress(), &Theme::LIGHT);
    let yellow = canvas.pixels.iter().filter(|p| p[0] > 200 && p[1] > 180 && p[2] < 120).count();
    assert!(yellow > 200, "{yellow} pixels at the top of the scale");
    assert_eq!(canvas.pixels[0], Theme::LIGHT.panel);
    let grey = canvas.pixels.iter().filter(|p| p[0].abs_diff(p[2]) < 20 && **p != Theme::LIGHT.panel).count();
    assert!(grey > 1000, "{grey} pixels of plate");
}
