//! A program is killed at each system call of its start, of its first 100 ms and of its stop. Started again, it works, and
//! leaves what a run without a kill leaves.
//!
//! `SOFTTWIN_KILLS=all` kills at every call (some 20 minutes); otherwise a sample of the calls is taken.

use std::collections::{BTreeSet, HashMap};
use std::path::PathBuf;
use std::time::{Duration, Instant};
use tests::wait::{fresh, states, wait_state};
use tests::{PATIENCE, Program, Stage};

/// The calls that make, change or remove something, or tell others of it. Others change nothing that a successor could meet.
/// `?`: a call that not every machine has.
const CALLS: &str = "?open,openat,ftruncate,fallocate,?chmod,fchmod,fchmodat,mmap,munmap,?mkdir,mkdirat,?link,linkat,\
                     ?rename,?renameat,renameat2,?unlink,unlinkat,?rmdir,bind,connect,sendto,flock,fcntl,write,pwrite64,\
                     close,clone,?clone3";
/// Calls of each program that are taken when not all are.
const SAMPLE: usize = 36;
/// How long a program runs before it is told to stop.
const RUN: Duration = Duration::from_millis(100);

const SOURCE: &str = "kind = \"simulate\"\nrate_hz = 50.0\ngap_mm = 30.0\n";

/// A program and the line that shows that it works.
struct Subject<'a> {
    command: Vec<&'a str>,
    ready: &'a str,
}

/// A system call and its how-many-th in a thread.
type Point = (String, usize);

impl Subject<'_> {
    /// Runs the program, killed at `point` or not at all.
    fn run(&self, stage: &Stage, point: Option<&Point>) -> (Option<i32>, bool, Vec<String>) {
        forget_recordings(stage);
        let program = match point {
            None => Program::named(stage, &self.command),
            Some((call, number)) => {
                let trace = format!("trace={CALLS}");
                let kill = format!("inject={call}:signal=SIGKILL:when={number}");
                Program::traced(stage, &["-o", "/dev/null", "-e", &trace, "-e", &kill], &self.command)
            }
        };
        program.run_and_stop(self.ready, RUN)
    }

    /// The calls of an undisturbed run, in their order.
    fn points(&self, stage: &Stage) -> Vec<Point> {
        forget_recordings(stage);
        let log = stage.path("calls");
        let tracing = ["-o", &log.display().to_string(), "-e", &format!("trace={CALLS}")];
        let (code, ready, said) =
            Program::traced(stage, &tracing, &self.command).run_and_stop(self.ready, RUN);
        assert!(code == Some(0) && ready, "{code:?} {said:?}");
        let (mut counts, mut points) = (HashMap::new(), Vec::new());
        let domain = [stage.root().display().to_string(), "/dev/shm".into()];
        let mut in_domain = false; // what the loader does before can leave nothing
        for line in std::fs::read_to_string(&log).expect("strace wrote it").lines() {
            in_domain |= domain.iter().any(|place| line.contains(place));
            let Some((thread, call)) = line.split_once('(').and_then(|(head, _)| head.split_once(' ')) else {
                continue; // the second half of a call, a signal, an exit
            };
            let count = counts.entry((thread.to_owned(), call.trim().to_owned())).or_insert(0);
            *count += 1;
            let point = (call.trim().to_owned(), *count);
            if in_domain && !points.contains(&point) {
                points.push(point);
            }
        }
        assert!(points.len() > 50, "strace saw {} calls only", points.len());
        points
    }

    /// Kills the program at its calls, each time followed by an undisturbed run.
    fn withstands(&self, stage: &Stage, mut after_each: impl FnMut()) {
        // What both of two clean runs leave: a living program lets go of the first one's connections during the second.
        let clean_run = || {
            let (code, ready, said) = self.run(stage, None);
            assert!(code == Some(0) && ready, "{code:?} {said:?}");
            stage.everything()
        };
        let clean = &clean_run() & &clean_run();
        let points = self.points(stage);
        let all = std::env::var("SOFTTWIN_KILLS").is_ok_and(|wanted| wanted == "all");
        let stride = if all { 1 } else { points.len().div_ceil(SAMPLE) };
        let (mut killed, mut slowest, mut wrong) = (0, Duration::ZERO, Vec::new());
        for point in points.iter().step_by(stride) {
            killed += usize::from(self.run(stage, Some(point)).0.is_none());
            let begin = Instant::now();
            let (code, ready, said) = self.run(stage, None);
            slowest = slowest.max(begin.elapsed());
            if code != Some(0) || !ready {
                wrong.push(format!("{point:?}: started again: {code:?} {said:?}"));
                break; // the domain is locked: nothing after this would tell more
            }
            if let Some(difference) = difference(&clean, stage) {
                wrong.push(format!("{point:?}: {difference}"));
            }
            after_each();
        }
        println!(
            "{:?}: {killed} kills at {} calls, slowest run after one {slowest:?}",
            self.command,
            points.len()
        );
        assert!(wrong.is_empty(), "{} of {killed}:\n{}", wrong.len(), wrong.join("\n"));
        assert!(killed > SAMPLE / 2, "only {killed} kills");
    }
}

/// The recorder never overwrites a file.
fn forget_recordings(stage: &Stage) {
    let _absent_is_fine = std::fs::remove_file(stage.path("run.mcap"));
}

/// What is there beside, or missing from, what a clean run leaves. Living programs let go of a dead partner's connections
/// with their next sample: they are given some time.
fn difference(clean: &BTreeSet<PathBuf>, stage: &Stage) -> Option<String> {
    let end = Instant::now() + Duration::from_secs(2);
    loop {
        let found = stage.everything();
        if found == *clean {
            return None;
        }
        if Instant::now() > end {
            let left: Vec<_> = found.difference(clean).collect();
            let gone: Vec<_> = clean.difference(&found).collect();
            return Some(format!("left {left:?}, gone {gone:?}"));
        }
        std::thread::yield_now();
    }
}

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
    let command = vec!["softtwin", "record", "--out", "run.mcap", "--seconds", "0.3"];
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
