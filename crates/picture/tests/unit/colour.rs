//! Tests of `src/colour.rs`.

use super::*;

/// Relative luminance of a linear colour.
fn luminance([r, g, b]: [f32; 3]) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

#[test]
fn sequential_map_is_strictly_increasing_in_lightness() {
    let map = ColourMap::stress();
    for k in 1..ENTRIES {
        assert!(luminance(map.table[k]) > luminance(map.table[k - 1]), "entry {k}");
    }
}

#[test]
fn diverging_map_is_white_in_the_middle_and_dark_at_both_ends() {
    let map = ColourMap::diverging();
    let [low, middle, high] = [0.0, 0.5, 1.0].map(|t| map.srgb(t));
    assert!(middle.iter().all(|v| *v > 225), "{middle:?}");
    assert!(low[2] > low[0] + 60 && high[0] > high[2] + 60, "{low:?} {high:?}");
}

#[test]
fn values_out_of_range_take_the_end_colours_and_nan_is_grey() {
    let map = ColourMap::stress();
    assert_eq!(map.srgb(-3.0), map.srgb(0.0));
    assert_eq!(map.srgb(7.0), map.srgb(1.0));
    let grey = map.srgb(f32::NAN);
    assert!(grey[0] == grey[1] && grey[1] == grey[2]);
}

#[test]
fn srgb_coding_is_invertible() {
    for byte in 0..=255 {
        assert_eq!(encode(decode(byte)), byte);
    }
}
