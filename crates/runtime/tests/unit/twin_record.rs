//! Tests of `src/twin/record.rs` that need its private parts.

use super::*;

const MS: u64 = 1_000_000;

#[test]
fn the_alarm_comes_after_the_time_and_goes_at_once() {
    let mut watch = ForceWatch::default();
    let mut at = |ms: u64, residual_n: f64| watch.update(ms * MS, residual_n, 0.02, 300 * MS);
    assert!(!at(0, 0.01) && !at(100, -0.5) && !at(399, 0.5), "outside for 299 ms is no alarm");
    assert!(at(400, -0.5) && at(500, 0.03), "300 ms are, on either side");
    assert!(!at(600, 0.02), "back inside: over");
    assert!(!at(700, 0.5) && at(1_000, 0.5), "and the time restarts");
}

#[test]
fn outlier_or_missing_value_restarts_the_time() {
    let mut watch = ForceWatch::default();
    for ms in 0..1_000u64 {
        let residual_n = if ms % 100 == 99 { f64::NAN } else { 1.0 };
        assert!(!watch.update(ms * MS, residual_n, 0.02, 200 * MS), "{ms} ms");
    }
    assert!(!watch.update(0, 1.0, f64::NAN, 0), "without a half-width nothing can be said");
}

#[test]
fn a_full_channel_loses_the_newest_and_counts_them() {
    let (sender, receiver) = event_channel();
    let event = |value| Event { t_ns: 1, actuator: 0, kind: EventKind::Missed, value };
    (0..CAPACITY as u64 + 5).for_each(|value| sender.send(event(value)));
    assert_eq!(sender.lost(), 5);
    assert!(receiver.try_iter().map(|event| event.value).eq(0..CAPACITY as u64));
}
