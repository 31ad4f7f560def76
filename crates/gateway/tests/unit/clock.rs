//! Tests of `src/readings.rs` that need its private parts.

use super::*;

const MS: u64 = 1_000_000;

#[test]
fn a_late_reading_is_as_old_as_it_is_late() {
    let mut clock = SenderClock::default();
    let ours = |t_sender: u64| t_sender + 7_000_000 * MS; // the other machine was started later
    let mut local = |t_sender: u64, delay: u64| clock.local_ns(9, t_sender, ours(t_sender) + delay);
    assert_eq!(local(0, 3 * MS), ours(3 * MS), "the first counts as taken when it came");
    assert_eq!(local(10 * MS, MS), ours(11 * MS), "a faster one is the better measure");
    assert_eq!(local(20 * MS, 501 * MS), ours(21 * MS), "500 ms late");
    assert_eq!(local(15 * MS, 510 * MS), ours(16 * MS), "backwards stays backwards");
}

#[test]
fn a_better_measure_of_the_distance_does_not_turn_the_order() {
    let mut clock = SenderClock::default();
    let first = clock.local_ns(1, 0, 5 * MS);
    let second = clock.local_ns(1, MS, 2 * MS + 5 * MS / 2);
    assert!(second >= first, "{second} before {first}");
    assert!(clock.local_ns(1, MS / 2, 6 * MS) < second, "what the sender turned round stays turned round");
}

#[test]
fn clocks_that_drift_stay_together() {
    let mut clock = SenderClock::default();
    for second in 0..3600u64 {
        let t_sender = second * 1000 * MS;
        let drifted = t_sender + t_sender / 20_000 + MS; // 50 ppm, 1 ms on the way
        let local = clock.local_ns(1, t_sender, drifted);
        assert!(local <= drifted && drifted - local <= 3 * MS, "after {second} s: {} ns", drifted - local);
    }
}

#[test]
fn restarted_sender_restarts_the_clock_without_overflow() {
    let mut clock = SenderClock::default();
    assert_eq!(clock.local_ns(1, u64::MAX, 5), 5);
    assert!(clock.local_ns(1, 0, 6) < 5, "older than this machine's clock");
    assert_eq!(clock.local_ns(2, 0, u64::MAX), u64::MAX);
}
