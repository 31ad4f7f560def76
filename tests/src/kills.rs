//! Kills a program at system calls of its start, its first 100 ms and its stop. After a restart it must work and leave the
//! same files as a run without a kill.
//!
//! `SOFTTWIN_KILLS=all` kills at every call; the default is a sample of the calls.

use crate::{Program, Stage};
use std::collections::{BTreeSet, HashMap};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// System calls that create, change or remove files and connections, or notify other programs. `?` marks calls that not every
/// machine has.
const CALLS: &str = "?open,openat,ftruncate,fallocate,?chmod,fchmod,fchmodat,mmap,munmap,?mkdir,mkdirat,?link,linkat,\
                     ?rename,?renameat,renameat2,?unlink,unlinkat,?rmdir,bind,connect,sendto,flock,fcntl,write,pwrite64,\
                     close,clone,?clone3";
/// Number of calls per program in the default sample.
const SAMPLE: usize = 24;
/// Longer than the interval of health.
const SETTLED: Duration = Duration::from_millis(1500);
/// Run time of a program before SIGTERM.
pub const RUN: Duration = Duration::from_millis(100);

/// Program under test and the line that shows that it works.
#[derive(Debug)]
pub struct Subject<'a> {
    /// Name and arguments.
    pub command: Vec<&'a str>,
    /// Part of the line.
    pub ready: &'a str,
}

/// System call and its ordinal within a thread.
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
        let mut in_domain = false; // calls of the program loader leave nothing
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

    /// Kills the program at its calls. An undisturbed run and then `after_each` follow each kill.
    ///
    /// # Panics
    /// If a run after a kill fails or leaves other files than a clean run.
    pub fn withstands(&self, stage: &Stage, mut after_each: impl FnMut()) {
        // Files that all clean runs of `SETTLED` leave: running programs close the connections of one run during the next, those of
        // health once a second.
        let clean_run = || {
            let (code, ready, said) = self.run(stage, None);
            assert!(code == Some(0) && ready, "{code:?} {said:?}");
            stage.everything()
        };
        let (begin, mut clean) = (Instant::now(), clean_run());
        loop {
            clean = &clean & &clean_run();
            if begin.elapsed() > SETTLED {
                break;
            }
        }
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
                break; // the shared-memory domain is locked, so later points would fail too
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

/// Difference between the stage's files and those that a clean run leaves; `None` if there is none within 2 s. Running programs
/// close connections to a dead partner with their next sample.
pub fn difference(clean: &BTreeSet<PathBuf>, stage: &Stage) -> Option<String> {
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
        std::thread::sleep(Duration::from_millis(2));
    }
}
