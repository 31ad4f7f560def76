//! A program is killed at each system call of its start, of its first 100 ms and of its stop. Started again, it works, and
//! leaves what a run without a kill leaves.
//!
//! `SOFTTWIN_KILLS=all` kills at every call; otherwise a sample of the calls is taken.

use crate::{Program, Stage};
use std::collections::{BTreeSet, HashMap};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// The calls that make, change or remove something, or tell others of it. Others change nothing that a successor could meet.
/// `?`: a call that not every machine has.
const CALLS: &str = "?open,openat,ftruncate,fallocate,?chmod,fchmod,fchmodat,mmap,munmap,?mkdir,mkdirat,?link,linkat,\
                     ?rename,?renameat,renameat2,?unlink,unlinkat,?rmdir,bind,connect,sendto,flock,fcntl,write,pwrite64,\
                     close,clone,?clone3";
/// Calls of each program that are taken when not all are.
const SAMPLE: usize = 24;
/// How long a program runs before it is told to stop.
pub const RUN: Duration = Duration::from_millis(100);

/// A program and the line that shows that it works.
#[derive(Debug)]
pub struct Subject<'a> {
    /// Its name and its arguments.
    pub command: Vec<&'a str>,
    /// A part of the line.
    pub ready: &'a str,
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

    /// Kills the program at its calls, each time followed by an undisturbed run; `after_each` is called after both.
    ///
    /// # Panics
    /// When a run after a kill fails, or leaves something else than a clean run does.
    pub fn withstands(&self, stage: &Stage, mut after_each: impl FnMut()) {
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
        std::thread::yield_now();
    }
}
