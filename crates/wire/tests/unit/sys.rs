//! Tests of `src/sys.rs`.

use super::*;

#[test]
fn background_thread_changes_only_its_own_policy() {
    // SAFETY: takes no pointers.
    let policy = || unsafe { libc::sched_getscheduler(0) };
    let before = policy();
    let background = std::thread::spawn(move || {
        background_thread();
        policy()
    });
    let expected = if before == libc::SCHED_OTHER { libc::SCHED_BATCH } else { before };
    assert_eq!((background.join().unwrap(), policy()), (expected, before));
}
