//! Tests of `src/database/ansys/array.rs` that need its private parts.

use super::*;

#[test]
fn wrong_counts_are_refused_and_right_ones_read() {
    let file = |count: u64, values: &[f64]| {
        let body = values.iter().flat_map(|v| v.to_le_bytes());
        count.to_le_bytes().into_iter().chain(body).collect::<Vec<u8>>()
    };
    assert_eq!(parse(&file(2, &[1.5, -2.0])), Ok(vec![1.5, -2.0]));
    for wrong in [vec![], file(3, &[1.0]), file(u64::MAX, &[1.0]), file(1, &[f64::NAN]), file(0, &[1.0])] {
        assert!(parse(&wrong).is_err(), "{wrong:?}");
    }
}
