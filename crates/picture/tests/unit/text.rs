//! Tests of `src/text.rs`.

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
fn aligned_text_is_at_its_anchor() {
    let (left, _) = inked_columns(Align::Left);
    assert!((100..106).contains(&left), "{left}");
    let (_, right) = inked_columns(Align::Right);
    assert!((94..=100).contains(&right), "{right}");
    let (left, right) = inked_columns(Align::Centre);
    assert!((left + right).abs_diff(200) <= 6, "{left} {right}");
}

#[test]
fn every_character_of_the_captions_has_a_visible_glyph() {
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
