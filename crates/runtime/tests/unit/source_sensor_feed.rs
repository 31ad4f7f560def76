//! Tests of `src/source/sensor/feed.rs` that need its private parts.

use super::*;

#[test]
fn pauses_double_up_to_the_limit_and_start_anew() {
    let mut backoff = Backoff::new(Duration::from_millis(100));
    let pauses: Vec<u128> = (0..5).map(|_| backoff.take().as_millis()).collect();
    assert_eq!(pauses, [20, 40, 80, 100, 100]);
    backoff.reset();
    assert_eq!(backoff.take().as_millis(), 20);
}
