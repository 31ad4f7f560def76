//! Threads that must not hold up the one that answers readings.

/// Makes the calling thread one that interrupts no other when it wakes (`SCHED_BATCH`): it runs as soon as its core, or another one, is idle, with
/// the same share of it as before. For work that nobody waits for. Needs no rights; a thread with real-time rights keeps them.
pub fn background_thread() {
    let parameters = libc::sched_param { sched_priority: 0 };
    // SAFETY: the parameters live across the call; 0 means the calling thread.
    unsafe {
        if libc::sched_getscheduler(0) == libc::SCHED_OTHER {
            let _ordinary_otherwise = libc::sched_setscheduler(0, libc::SCHED_BATCH, &parameters);
        }
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_thread_in_the_background_is_one_and_others_are_not() {
        // SAFETY: takes no pointers.
        let policy = || unsafe { libc::sched_getscheduler(0) };
        let before = policy();
        let beside = std::thread::spawn(move || {
            super::background_thread();
            policy()
        });
        let expected = if before == libc::SCHED_OTHER { libc::SCHED_BATCH } else { before };
        assert_eq!((beside.join().unwrap(), policy()), (expected, before));
    }
}
