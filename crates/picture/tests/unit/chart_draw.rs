//! Tests of `src/chart/draw.rs`.

use super::*;

#[test]
fn halved_picture_is_the_mean_of_four_pixels() {
    let rgb: Vec<u8> = [[0, 10, 20], [4, 10, 0], [8, 10, 0], [8, 10, 0]].concat();
    assert_eq!(halved(&rgb, 2), [5, 10, 5]);
}

#[test]
fn a_line_leaves_out_what_nobody_can_see_and_keeps_its_peaks() {
    let mut wave: Vec<(i32, i32)> =
        (0..2000).map(|k| (k, (1000.0 * (f64::from(k) / 150.0).sin()).round() as i32)).collect();
    wave[777].1 = 4000;
    let kept = corners(&wave, 2.0);
    assert!(kept.len() < 200 && kept.contains(&777) && kept.ends_with(&[1999]), "{}", kept.len());
    for pair in kept.windows(2) {
        for left_out in &wave[pair[0]..pair[1]] {
            assert!(distance(*left_out, wave[pair[0]], wave[pair[1]]) <= 2.0, "{left_out:?}");
        }
    }
    let flat: Vec<(i32, i32)> = (0..100).map(|k| (k, 5)).collect();
    assert_eq!((corners(&flat, 2.0), corners(&[], 2.0)), (vec![0, 99], vec![]));
}

#[test]
fn pieces_of_a_curve_are_one_line_of_an_svg() {
    let curve = (0..300).map(|k| (f64::from(k), (f64::from(k) / 20.0).sin()));
    let panel = Panel::new("", "x", "y", vec![Series::line("", 0, curve)]);
    let drawn = Figure::one("", panel).svg().unwrap();
    let blue: Vec<&str> = drawn.lines().filter(|line| line.contains("#005493")).collect();
    assert!(blue.len() == 1 && blue[0].ends_with("\"/>") && blue[0].matches(',').count() > 50, "{blue:?}");
    // A style ends a line, and so does a gap.
    let pieces = "<svg>\n<polyline a points=\"0,0 1,1 \"/>\n<polyline a points=\"1,1 2,3 \"/>\n<polyline b points=\"2,3 4,4 \"/>\n</svg>\n";
    let [first, second] = ["a points=\"0,0 1,1 2,3\"", "b points=\"2,3 4,4\""];
    let round = "<polyline stroke-linejoin=\"round\"";
    assert_eq!(joined(pieces), format!("<svg>\n{round} {first}/>\n{round} {second}/>\n</svg>\n"));
}
