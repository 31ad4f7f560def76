//! Tests of `src/cmd/draw/states.rs`.

use super::*;

#[test]
fn gaps_of_fig_9_are_in_the_models_range() {
    assert_eq!(fig9_gaps_mm(Some([10.0, 72.0])), FIG9_GAPS_MM);
    assert_eq!(fig9_gaps_mm(Some([20.0, 20.0])), [20.0]);
    assert_eq!(fig9_gaps_mm(Some([5.0, 25.0])), [25.0, 15.0, 5.0]);
    assert_eq!(fig9_gaps_mm(None), [80.0]);
}

#[test]
fn pressures_are_rounded_downwards_into_the_range() {
    assert_eq!([0.02999, 0.03, 0.123, 1.0].map(rounded_down), [0.029, 0.03, 0.12, 1.0]);
}
