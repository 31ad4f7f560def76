//! Tests of `src/scale.rs`.

use super::*;
use proptest::prelude::*;

#[test]
fn ticks_are_round_and_their_labels_differ() {
    let scale = Scale::new([0.0, 0.46], 4);
    assert_eq!(scale.ticks.iter().map(|t| scale.text(*t)).collect::<Vec<_>>(), ["0.0", "0.2", "0.4"]);
    let scale = Scale::new([-1.0, 1.0], 4);
    assert_eq!(
        scale.ticks.iter().map(|t| scale.text(*t)).collect::<Vec<_>>(),
        ["-1.0", "-0.5", "0.0", "0.5", "1.0"]
    );
}

#[test]
fn rounding_widens_to_whole_ticks() {
    assert_eq!(Scale::rounded([0.0, 0.46], 5).range, [0.0, 0.5]);
    assert_eq!(Scale::rounded([0.0, 0.5], 5).range, [0.0, 0.5]);
}

#[test]
fn range_without_width_has_one_tick() {
    assert_eq!(Scale::new([3.0, 3.0], 5).ticks, [3.0]);
    assert_eq!(Scale::rounded([f32::NAN, 1.0], 5).ticks.len(), 1);
}

proptest! {
    #[test]
    fn ticks_ascend_within_the_range(low in -1e3_f32..1e3, span in 1e-3_f32..1e4, count in 2_usize..9) {
        let scale = Scale::new([low, low + span], count);
        prop_assert!(scale.ticks.windows(2).all(|pair| pair[0] < pair[1]));
        prop_assert!(scale.ticks.len() <= count + 1);
        let slack = 1e-3 * span;
        prop_assert!(scale.ticks.iter().all(|t| *t >= low - slack && *t <= low + span + slack));
    }
}
