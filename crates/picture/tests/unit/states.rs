//! Tests of `src/states.rs`.

use super::*;

#[test]
fn ranges_are_two_ascending_numbers() {
    assert_eq!(parse_range("0:0.5"), Ok([0.0, 0.5]));
    assert_eq!(parse_range(" -1 : 2e1 "), Ok([-1.0, 20.0]));
    for wrong in ["", "1", "1:", "2:1", "1:1", "nan:1", "0:inf", "a:b"] {
        assert!(parse_range(wrong).is_err(), "{wrong}");
    }
}
