//! Programs killed at their system calls, see [`tests::kills`]: nothing that is left may be in the way of the next one.
//!
//! `SOFTTWIN_KILLS=all` takes over an hour (the bridge alone has some 260 calls).

use std::time::Duration;
use tests::kills::{RUN, Subject};
use tests::wait::{fresh, states, wait_state, wait_until};
use tests::{Program, Stage};

const SOURCE: &str = "kind = \"simulate\"\nrate_hz = 50.0\ngap_mm = 30.0\n";

#[test]
fn bridge_killed_at_any_call_can_be_restarted() {
    let stage = Stage::new("kill_bridge");
    let scene = stage.finger(SOURCE).display().to_string();
    let command = vec!["softtwind", "bridge", "--scene", &scene];
    Subject { command, ready: "ready:" }.withstands(&stage, || {});
}

#[test]
fn twin_killed_at_any_call_can_be_restarted() {
    let stage = Stage::new("kill_twin");
    let scene = stage.finger(SOURCE).display().to_string();
    let command = vec!["softtwind", "twin", "--scene", &scene];
    Subject { command, ready: "ready:" }.withstands(&stage, || {});
}

/// An incomplete connection of a killed reader must not delay the twin.
#[test]
fn reader_killed_at_any_call_does_not_delay_the_twin() {
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
fn recorder_killed_at_any_call_does_not_delay_the_twin() {
    let stage = Stage::new("kill_recorder");
    let scene = stage.finger(SOURCE);
    let (_twin, _bridge) = (Program::twin(&stage, &scene), Program::bridge(&stage, &scene));
    let bus = stage.bus();
    wait_state(&states(&bus), "a fresh state", fresh);
    let command = vec!["softtwin", "record", "--out", "run.mcap", "--seconds", "0.1"];
    Subject { command, ready: "written" }.withstands(&stage, || {});
}

/// The shared-memory domain has the same files after many readers were killed during their start.
#[test]
fn readers_killed_during_their_start_leave_no_files() {
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
        // Kills at 60 different moments of the first 30 ms.
        std::thread::sleep(Duration::from_micros(500 * (round * 7 % 60)));
        reader.kill();
    }
    assert_eq!(list().0, Some(0));
    // Files of the bridge's own reader of the health may have gone.
    wait_until("a folder without files of dead readers", || {
        stage.everything().is_subset(&clean).then_some(())
    });
}

/// The wait for the start lock has a limit.
#[test]
fn held_start_lock_ends_the_twin_with_its_name() {
    let stage = Stage::new("kill_locked");
    let scene = stage.finger(SOURCE).display().to_string();
    drop(stage.bus());
    let lock = std::fs::File::open(stage.root().join("softtwin.lock")).expect("made with the first bus");
    lock.lock().expect("an unlocked file");
    let (status, said) = Program::named(&stage, &["softtwind", "twin", "--scene", &scene]).ended();
    assert_eq!(status.code(), Some(1), "{said:?}");
    assert!(said.iter().any(|line| line.contains("softtwin.lock")), "{said:?}");
}

#[test]
fn too_long_names_are_refused_with_the_limit() {
    let mut stage = Stage::new("kill_names");
    stage.domain_name = "n".repeat(150);
    for command in [vec!["softtwin", "list"], vec!["softtwin", "echo", "softtwin/finger/state"]] {
        let (status, said) = Program::named(&stage, &command).ended();
        assert_eq!(status.code(), Some(78), "{said:?}");
        let said = said.join("\n");
        assert!(said.contains("61") && !said.contains("panicked"), "{said}");
    }
}
