//! Tests of `src/canvas.rs`.

use super::*;

#[test]
fn drawing_outside_is_clipped() {
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
fn written_png_reads_back_equal() {
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
