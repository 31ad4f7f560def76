//! Tests of `src/cmd/view.rs`.

use super::*;

#[test]
fn random_tokens_are_alphanumeric_and_long() {
    assert!(parse_token("abcdef12").is_ok());
    for wrong in ["", "short", "with space 1", "semi;colon1", &"a".repeat(65)] {
        assert!(parse_token(wrong).is_err(), "{wrong}");
    }
}
