//! Tests of `src/message/gap.rs` that need its private parts.

use super::*;

#[test]
fn a_jump_is_a_gap_and_a_new_publisher_is_not() {
    let mut gaps = GapCounter::default();
    let mut observe = |boot_id, seq| gaps.observe(Stamp { boot_id, seq, t_sensor_ns: 0, t_publish_ns: 0 });
    assert_eq!(observe(1, 10), None, "the first sample starts the count");
    assert_eq!(observe(1, 11), None);
    assert_eq!(observe(1, 15), Some(Gap { expected_seq: 12, found_seq: 15 }));
    assert_eq!(observe(2, 900), None, "another boot id is another publisher");
    assert_eq!(observe(2, 899), None, "backwards is not a loss");
    assert_eq!(observe(2, 902), Some(Gap { expected_seq: 900, found_seq: 902 }), "two were lost after 899");
    assert_eq!(observe(2, u64::MAX).map(Gap::missing), Some(u64::MAX - 903));
    assert_eq!(observe(2, u64::MAX), None);
}
