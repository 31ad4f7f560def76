//! Tests of `src/twin/record.rs` that need its private parts.

use super::*;

#[test]
fn a_full_channel_loses_the_newest_and_counts_them() {
    let (sender, receiver) = event_channel();
    let event = |value| Event { t_ns: 1, actuator: 0, kind: EventKind::Missed, value, input: [0; 32] };
    (0..CAPACITY as u64 + 5).for_each(|value| sender.send(event(value)));
    assert_eq!(sender.lost(), 5);
    assert!(receiver.try_iter().map(|event| event.value).eq(0..CAPACITY as u64));
}
