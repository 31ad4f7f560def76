//! Tests of `src/chart/draw.rs`.

use super::*;

#[test]
fn halved_picture_is_the_mean_of_four_pixels() {
    let rgb: Vec<u8> = [[0, 10, 20], [4, 10, 0], [8, 10, 0], [8, 10, 0]].concat();
    assert_eq!(halved(&rgb, 2), [5, 10, 5]);
}
