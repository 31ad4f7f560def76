//! Supervised threads: none ends unnoticed, and all end with their group.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::time::Duration;
use wire::thread_group::{StopFlag, ThreadEnded, ThreadGroup, ThreadResult};

const LONG: Duration = Duration::from_secs(60);

/// How a thread with this work ends the program beside a healthy one.
fn end_of(work: impl FnOnce(&StopFlag) -> ThreadResult + Send + 'static) -> ThreadEnded {
    let stop = Arc::new(AtomicBool::new(false));
    let mut group = ThreadGroup::new(stop.clone());
    let healthy = |end: &StopFlag| {
        end.pause(LONG);
        Ok(())
    };
    group.start("healthy", healthy).unwrap();
    group.start("softtwin/finger/sensor", work).unwrap();
    while !stop.load(Ordering::Acquire) {
        std::thread::sleep(Duration::from_millis(2));
    }
    assert_eq!(group.check(), Err(group.check().unwrap_err()));
    group.end().unwrap_err()
}

#[test]
fn a_thread_that_ends_unasked_ends_the_program_and_is_named_with_its_cause() {
    for (ended, cause) in [
        (end_of(|_| Ok(())), "it returned"),
        (end_of(|_| Err("no disk".into())), "no disk"),
        (end_of(|_| panic!("index {}", 7)), "it panicked: index 7"),
        (end_of(|_| panic!("of the thread")), "it panicked: of the thread"),
    ] {
        assert_eq!(ended.thread, "softtwin/finger/sensor");
        assert!(ended.cause.starts_with(cause), "{ended}");
    }
}

/// A reload that reads a large file must not delay the end of the program.
#[test]
fn work_is_left_when_the_thread_is_asked_to_end() {
    let (mut group, (sender, outcomes)) = (ThreadGroup::default(), mpsc::channel());
    group
        .start("loader", move |end| {
            assert_eq!(end.unless_set(|| 7), Some(7));
            assert!(catch_unwind(AssertUnwindSafe(|| end.unless_set(|| panic!("while reading")))).is_err());
            sender.send(None)?;
            // Never ends.
            sender.send(Some(end.unless_set(|| std::thread::sleep(LONG * 1000))))?;
            Ok(())
        })
        .unwrap();
    assert_eq!(outcomes.recv().unwrap(), None);
    group.end().unwrap();
    assert_eq!(outcomes.recv().unwrap(), Some(None));
}

#[test]
fn threads_that_were_asked_to_end_are_no_failure_and_are_waited_for() {
    let (sender, ends) = mpsc::channel();
    let wait = move |end: &StopFlag| {
        while !end.is_set() {
            end.pause(LONG);
        }
        sender.send(())?;
        Err("after the end".into())
    };
    let mut group = ThreadGroup::default();
    group.start("worker", wait.clone()).unwrap();
    group.check().unwrap();
    group.end().unwrap();
    ends.try_recv().expect("it was waited for");

    // Also when the program's own loop panics.
    let panicked = catch_unwind(AssertUnwindSafe(|| {
        let mut group = ThreadGroup::default();
        group.start("worker", wait).unwrap();
        panic!("the loop");
    }));
    assert!(panicked.is_err());
    ends.try_recv().expect("it was waited for");
}

#[test]
fn the_programs_own_flag_ends_the_threads_of_a_group_that_shares_it() {
    let program = Arc::new(AtomicBool::new(false));
    let mut group = ThreadGroup::with_program(program.clone());
    let (sender, ends) = mpsc::channel();
    let work = move |end: &StopFlag| {
        while !end.is_set() {
            end.pause(LONG);
        }
        Ok(sender.send(())?)
    };
    group.start("worker", work).unwrap();
    program.store(true, Ordering::Release);
    ends.recv_timeout(LONG).expect("it ended");
    group.end().unwrap();
}
