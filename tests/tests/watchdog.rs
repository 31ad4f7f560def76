//! Watchdog with one stalled thread while the notifying thread runs. `strace` delays one system call of the stalled thread.

use std::process::Command;
use std::time::{Duration, Instant};
use tests::skip::{Missing, skipped};
use tests::{Manager, Program, Stage};

const STEADY: &str = "kind = \"simulate\"\nrate_hz = 200.0\ngap_mm = 30.0";

/// Starts a program of which the calls `call` of each thread are held for 5 s, from the `when`-th on.
fn stalling(stage: &Stage, manager: &Manager, call: &str, when: u32, program: &[&str]) -> Program {
    let (trace, inject) = (format!("trace={call}"), format!("inject={call}:delay_exit=5000000:when={when}+"));
    let tracing = ["-o", "/dev/null", "-e", &trace, "-e", &inject];
    Program::traced_with(stage, &tracing, program, &manager.environment())
}

/// Feeding begins and then ends for at least 1.5 s, several times the 0.4 s that the manager allows; other messages are returned.
fn feeding_ends(manager: &Manager) -> Vec<String> {
    manager.receive("WATCHDOG=1");
    let (mut fed, mut others) = (Instant::now(), Vec::new());
    let end = Instant::now() + tests::PATIENCE;
    while fed.elapsed() < Duration::from_millis(1500) {
        assert!(Instant::now() < end, "it is fed although a thread stands still");
        match manager.next(Duration::from_millis(100)) {
            Some(message) if message.contains("WATCHDOG=1") => fed = Instant::now(),
            other => others.extend(other),
        }
    }
    others
}

#[test]
fn stalled_twin_loop_stops_watchdog_notifications() {
    let stage = Stage::new("stalltwin");
    let scene = stage.finger(STEADY).display().to_string();
    let manager = Manager::new(&stage);
    // Only the loop waits with `ppoll`: a second at 200 Hz, longer where one wait covers several readings.
    let program = stalling(&stage, &manager, "ppoll", 200, &["softtwind", "twin", "--scene", &scene]);
    let _bridge = Program::bridge(&stage, std::path::Path::new(&scene));
    feeding_ends(&manager);
    // The loader and the reporter live: a reload begins.
    program.signal(libc::SIGHUP);
    manager.receive("RELOADING=1");
    program.kill();
}

#[test]
fn stalled_disk_stops_the_recorders_watchdog_notifications() {
    let stage = Stage::new("stalldisk");
    let _bridge = Program::bridge(&stage, &stage.finger(STEADY));
    let manager = Manager::new(&stage);
    let out = stage.path("run.mcap").display().to_string();
    let program = stalling(&stage, &manager, "fdatasync", 8, &["softtwin", "record", "--out", &out]);
    let others = feeding_ends(&manager);
    assert!(
        others.iter().any(|message| message.contains("STATUS=")),
        "the thread that feeds lives: {others:?}"
    );
    program.kill();
}

/// Under the service manager itself, where one runs: the unit ends with the result `watchdog`.
#[test]
fn service_manager_ends_a_stalled_twin() {
    let running = Command::new("systemctl").args(["is-system-running"]).output();
    let state = running.map(|output| String::from_utf8_lossy(&output.stdout).trim().to_owned());
    if !state.is_ok_and(|state| state == "running" || state == "degraded") {
        return skipped(Missing::ServiceManager);
    }
    let stage = Stage::new("systemd");
    let scene = stage.finger(STEADY).display().to_string();
    let unit = format!("softtwin-test-{}", std::process::id());
    let program = tests::process::binary("softtwind").display().to_string();
    let (domain, root) = (
        format!("SOFTTWIN_DOMAIN={}", stage.domain_name),
        format!("SOFTTWIN_ROOT={}", stage.root().display()),
    );
    let started = Command::new("systemd-run")
        .args(["--unit", &unit, "--property=Type=notify", "--property=WatchdogSec=1s", "--setenv", &domain])
        .args(["--setenv", &root, &program, "twin", "--scene", &scene])
        .status();
    assert!(started.is_ok_and(|status| status.success()), "the unit starts and says that it is ready");
    let show = |what: &str| {
        let output = Command::new("systemctl").args(["show", "--value", "--property", what, &unit]).output();
        String::from_utf8_lossy(&output.expect("systemctl").stdout).trim().to_owned()
    };
    // The loop alone is stopped: its thread is the first of the process.
    let main: i32 = show("MainPID").parse().expect("a process");
    // SAFETY: the call has no pointers; the process is that of the unit we just started.
    assert_eq!(unsafe { libc::kill(main, libc::SIGSTOP) }, 0);
    tests::wait::wait_until("the result", || (show("Result") == "watchdog").then_some(()));
    let _cleared = Command::new("systemctl").args(["reset-failed", &unit]).status();
}
