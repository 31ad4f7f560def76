//! Tests of `src/message/gap.rs` that need its private parts.

use super::*;

#[test]
fn a_jump_is_a_gap_and_a_new_publisher_is_not() {
    let mut gaps = GapCounter::default();
    let mut missing = 0_i64;
    let mut observe = |boot_id, seq| {
        let observed = gaps.observe(Stamp { boot_id, seq, t_sensor_ns: 0, t_publish_ns: 0 });
        missing = missing.saturating_add(observed.missing);
        observed.gap
    };
    assert_eq!(observe(1, 10), None, "the first sample starts the count");
    assert_eq!(observe(1, 11), None);
    assert_eq!(observe(1, 15), Some(SequenceGap { expected_seq: 12, found_seq: 15 }));
    assert_eq!(observe(2, 900), None, "another boot id is another publisher");
    assert_eq!(observe(2, 899), None, "backwards is not a loss");
    assert_eq!(observe(2, 903), Some(SequenceGap { expected_seq: 901, found_seq: 903 }), "900 came");
    assert_eq!(
        (observe(2, 901), observe(2, 903), observe(2, 904)),
        (None, None, None),
        "late, repeated, next"
    );
    assert_eq!(observe(2, u64::MAX).map(SequenceGap::missing), Some(u64::MAX - 905));
    assert_eq!(observe(2, u64::MAX), None);
    assert_eq!((observe(2, 5), observe(2, 6)), (None, None), "the numbers begin again");
    assert_eq!(missing, i64::MAX, "the wrong number's gap");
}
