//! Tests of `src/frame.rs`.

use super::*;
use page::frame::{bits, encode};

#[test]
fn numbers_start_at_a_multiple_of_four_after_the_header() {
    for name in ["a", "ab", "abc", "abcd"] {
        let bytes = encode(&FrameHead::empty(name), &[&bits([1.5, -2.0].into_iter())]);
        let length = u32::from_le_bytes(bytes[..4].try_into().expect("four bytes")) as usize;
        let header: serde_json::Value = serde_json::from_slice(&bytes[4..4 + length]).expect("JSON");
        assert_eq!(header["actuator"], name);
        let start = (4 + length).next_multiple_of(4);
        assert_eq!(bytes[start..], [1.5_f32.to_le_bytes(), (-2.0_f32).to_le_bytes()].concat());
    }
}

#[test]
fn unknown_quantities_are_nan() {
    let header = serde_json::to_value(FrameHead::empty("finger")).expect("plain data");
    assert!(!header["contact_force_n"].is_number() && !header["force_halfwidth_n"].is_number());
    assert!(header["t_s"].is_null() && header["latency_ms"].is_null() && header["regime"] == "unknown");
}
