//! Programs killed at their system calls, see [`tests::kills`]: nothing that is left may be in the way of the next one.
//!
//! `SOFTTWIN_KILLS=all` takes over an hour (the bridge alone has some 260 calls).

use std::time::{Duration, Instant};
use tests::kills::{RUN, Subject, difference};
use tests::wait::{fresh, states, wait_state};
use tests::{PATIENCE, Program, Stage};

const SOURCE: &str = "kind = \"simulate\"\nrate_hz = 50.0\ngap_mm = 30.0\n";

#[test]
fn a_bridge_killed_at_any_call_leaves_nothing_in_the_way() {
    let stage = Stage::new("kill_bridge");
    let scene = stage.finger(SOURCE).display().to_string();
    let command = vec!["softtwind", "bridge", "--scene", &scene];
    Subject { command, ready: "ready:" }.withstands(&stage, || {});
}

#[test]
fn a_twin_killed_at_any_call_leaves_nothing_in_the_way() {
    let stage = Stage::new("kill_twin");
    let scene = stage.finger(SOURCE).display().to_string();
    let command = vec!["softtwind", "twin", "--scene", &scene];
    Subject { command, ready: "ready:" }.withstands(&stage, || {});
}

/// The twin goes on beside a reader that is killed: a half-made connection must not hold it up.
#[test]
fn a_reader_killed_at_any_call_disturbs_nobody() {
    let stage = Stage::new("kill_reader");
    let scene = stage.finger(SOURCE);
    let (_twin, _bridge) = (Program::twin(&stage, &scene), Program::bridge(&stage, &scene));
    let bus = stage.bus();
    let states = states(&bus);
    wait_state(&states, "a fresh state", fresh);
    let command = vec!["softtwin", "echo", "softtwin/finger/state"];
    let mut last = 0;
    Subject { command, ready: "finger" }.withstands(&stage, || {
        last = wait_state(&states, "a new state", |state| state.seq > last && fresh(state)).seq;
    });
}

#[test]
fn a_recorder_killed_at_any_call_disturbs_nobody() {
    let stage = Stage::new("kill_recorder");
    let scene = stage.finger(SOURCE);
    let (_twin, _bridge) = (Program::twin(&stage, &scene), Program::bridge(&stage, &scene));
    let bus = stage.bus();
    wait_state(&states(&bus), "a fresh state", fresh);
    let command = vec!["softtwin", "record", "--out", "run.mcap", "--seconds", "0.1"];
    Subject { command, ready: "messages in" }.withstands(&stage, || {});
}

/// The domain works as on the first day after many readers were killed while they started.
#[test]
fn readers_killed_while_they_start_leave_nothing_behind() {
    let stage = Stage::new("kill_many");
    let scene = stage.finger(SOURCE);
    let (_twin, _bridge) = (Program::twin(&stage, &scene), Program::bridge(&stage, &scene));
    let list = || Program::named(&stage, &["softtwin", "list"]).run_and_stop("no such line", RUN);
    assert_eq!(list().0, Some(0));
    let clean = stage.everything();
    let count =
        std::env::var("SOFTTWIN_KILLED_READERS").ok().and_then(|text| text.parse().ok()).unwrap_or(60);
    for round in 0..count {
        let reader = Program::named(&stage, &["softtwin", "echo", "softtwin/finger/state"]);
        // Somewhere in its first 30 ms, a different place each time.
        let end = Instant::now() + Duration::from_micros(500 * (round * 7 % 60));
        while Instant::now() < end {
            std::hint::spin_loop();
        }
        reader.kill();
    }
    assert_eq!(list().0, Some(0));
    assert_eq!(difference(&clean, &stage), None);
}

/// Waiting for something that never comes must not keep a program from being stopped.
#[test]
fn a_program_that_waits_for_the_start_lock_says_so_and_ends() {
    let stage = Stage::new("kill_locked");
    let scene = stage.finger(SOURCE).display().to_string();
    drop(stage.bus());
    let lock = std::fs::File::open(stage.root().join("softtwin.lock")).expect("made with the first bus");
    lock.lock().expect("nobody else has it");
    let begin = Instant::now();
    let (status, said) = Program::named(&stage, &["softtwind", "twin", "--scene", &scene]).ended();
    assert_eq!(status.code(), Some(1), "{said:?}");
    assert!(said.iter().any(|line| line.contains("softtwin.lock")), "{said:?}");
    assert!(begin.elapsed() < PATIENCE / 4, "{:?}", begin.elapsed());
}

#[test]
fn names_that_are_too_long_are_refused_with_what_is_allowed() {
    let mut stage = Stage::new("kill_names");
    stage.domain_name = "n".repeat(150);
    for command in [vec!["softtwin", "list"], vec!["softtwin", "echo", "softtwin/finger/state"]] {
        let (status, said) = Program::named(&stage, &command).ended();
        assert_eq!(status.code(), Some(1), "{said:?}");
        let said = said.join("\n");
        assert!(said.contains("at most 61 are allowed") && !said.contains("panicked"), "{said}");
    }
}
