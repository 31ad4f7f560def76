//! Tests of `src/sheet.rs`.

use super::super::scene::Plate;
use super::super::skin::DrawnBody;
use super::*;

fn body(y: f32) -> DrawnBody {
    let nodes_mm = vec![[0.0, y, 0.0], [110.0, y, 0.0], [60.0, y + 20.0, 30.0]];
    DrawnBody { nodes_mm, facets: vec![[0, 1, 2]], values: vec![0.0, 0.5, 1.0] }
}

fn sheet(bodies: &[DrawnBody], gap_mm: f32) -> Sheet<'_> {
    let plate = Some(Plate { gap_mm, x_mm: [0.0, 120.0], z_mm: [-9.0, 41.0] });
    let panel = |body| Panel {
        scene: Scene { body, plate, blocks: &[], range: [0.0, 1.0] },
        title: "0.01 MPa".into(),
        note: "0.1 N".into(),
    };
    Sheet {
        title: "Two states".into(),
        caption: "A caption that says what is seen here, long enough to need a second line of text.".into(),
        rows: vec![Row { heading: "gap".into(), panels: bodies.iter().map(panel).collect() }],
        bar_label: "von Mises stress (MPa)".into(),
        scale: Scale::new([0.0, 1.0], 4),
        map: ColourMap::stress(),
        camera: Camera::new(20.0, 20.0),
        panel_px: 160,
        text_px: 12.0,
        theme: Theme::LIGHT,
    }
}

#[test]
fn panels_are_side_by_side_and_not_empty() {
    let canvas = sheet(&[body(0.0), body(-5.0)], 30.0).draw().expect("fonts are embedded");
    assert!(canvas.width > 2 * 160 && canvas.width < 2 * 160 + 40);
    for half in 0..2 {
        let columns = half * canvas.width / 2..(half + 1) * canvas.width / 2;
        let coloured = (canvas.height / 2..canvas.height)
            .flat_map(|y| columns.clone().map(move |x| (x, y)))
            .filter(|(x, y)| {
                let p = canvas.pixels[y * canvas.width + x];
                p.iter().max().unwrap_or(&0) - p.iter().min().unwrap_or(&0) > 60
            });
        assert!(coloured.count() > 100, "half {half} has no coloured body");
    }
}

#[test]
fn colour_label_is_not_clipped() {
    let fonts = Fonts::embedded().expect("fonts are embedded");
    let bodies = [body(0.0)];
    for panel_px in [160, 400, 1600] {
        let sheet = Sheet { panel_px, ..sheet(&bodies, 30.0) };
        let bar = sheet.bar(&fonts, panel_px + 14, 7);
        let label_px = fonts.width_px(&sheet.bar_label, sheet.text_px, false);
        assert!(bar.width as f32 >= label_px, "{panel_px}: {} for {label_px}", bar.width);
        let beside = [(160, false), (1600, true)].into_iter().find(|(px, _)| *px == panel_px);
        assert!(beside.is_none_or(|(_, beside)| bar.beside == beside), "{panel_px}");
    }
}

#[test]
fn too_large_picture_is_an_error_before_allocation() {
    let bodies = [body(0.0)];
    let wide = Sheet { panel_px: 4000, ..sheet(&bodies, 1e6) };
    let error = wide.draw().expect_err("a plate a kilometre away");
    assert!(error.to_string().contains("100 megapixels"), "{error}");
}

#[test]
fn wider_gap_makes_a_higher_row_at_the_same_scale() {
    let bodies = [body(0.0)];
    let [near, far] = [15.0, 80.0].map(|gap| sheet(&bodies, gap).row_windows()[0]);
    assert!(far.1 > near.1);
    assert!((far.0.mm_per_px - near.0.mm_per_px).abs() < 1e-6);
}

#[test]
fn a_long_title_takes_further_lines() {
    let bodies = [body(0.0)];
    let short = sheet(&bodies, 30.0).draw().expect("fonts are embedded");
    let title = "P = 0.035 MPa, no plate, pressure_mpa.2 = 0.02, pressure_mpa.3 = 0.01".to_owned();
    let long = Sheet { title, ..sheet(&bodies, 30.0) }.draw().expect("fonts are embedded");
    assert!(long.width == short.width && long.height > short.height, "{} {}", long.height, short.height);
    assert_eq!(wrapped("one two three four", 2, |text| text.len() <= 7), ["one two", "three four"]);
    assert_eq!(wrapped("", 2, |_| true), [""]);
}

#[test]
fn a_ruler_has_a_round_length() {
    let lengths = [0.7, 1.0, 3.9, 17.0, 50.0, 120.0].map(ruler_mm);
    for (found, expected) in lengths.iter().zip([0.5, 1.0, 2.0, 10.0, 50.0, 100.0]) {
        assert!((found - expected).abs() < 1e-4 * expected, "{lengths:?}");
    }
}
