//! Tests of `src/link.rs` that need its private parts.

use super::*;

#[test]
fn one_thread_that_hangs_ends_the_rounds() {
    let mut liveness = Liveness::from_env();
    assert!(liveness.count() < liveness.count(), "before the threads start, each count is a round");
    let (quick, slow) = (liveness.add_thread(), liveness.add_thread());
    let begin = liveness.count();
    for _ in 0..3 {
        quick.store(true, Ordering::Relaxed);
        assert_eq!(liveness.count(), begin, "the slow thread hangs");
    }
    slow.store(true, Ordering::Relaxed);
    assert_eq!(liveness.count(), begin + 1);
    slow.store(true, Ordering::Relaxed);
    assert_eq!(liveness.count(), begin + 1, "now the quick one hangs");
}
