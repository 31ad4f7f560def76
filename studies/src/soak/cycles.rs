//! Months in compressed time: what happens once a day or once a week there happens thousands of times here, and nothing may grow.

use super::observe::{count_files, open_files};
use crate::slope::Slope;
use crate::testbed::{Sine, Testbed};
use anyhow::Context;
use serde_json::{Value, json};
use softtwin::daemon::{Daemon, program};
use softtwin::failure::configuration;
use softtwin::{output, resources};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};
use wire::{StateReader, Topic, WakeSet, Wakeable, Waking};

const EXAMPLES: &str = "\
Examples:
  All of it, for hours:
    cargo build --release --workspace --bins
    target/release/softtwin-studies cycles
  10 % of the cycles:
    target/release/softtwin-studies cycles --restarts 1000 --reloads 1000 --readers 10000";

const NOTES: &str = "\
One JSON object; ends with 1 when memory, open files or files in shared memory grow: the Theil-Sen slope over the cycles is above 0
with 99 % confidence, and its growth over the run is more than a page of memory or one file.";

/// Restart, reload, rotate and attach thousands of times; find what grows by its slope.
#[derive(clap::Args)]
#[command(before_help = EXAMPLES, after_help = NOTES)]
pub struct Args {
    /// Model file.
    #[arg(long, value_name = "FILE.twin", default_value = "models/pneunet/pneunet.twin")]
    model: PathBuf,
    /// Restarts of twin and bridge, every other one by SIGKILL.
    #[arg(long, value_name = "N", default_value_t = 10_000)]
    restarts: usize,
    /// Reloads of twin, bridge and recorder; each begins a new file of the recording, of which four are kept.
    #[arg(long, value_name = "N", default_value_t = 10_000)]
    reloads: usize,
    /// Readers that attach, read and go.
    #[arg(long, value_name = "N", default_value_t = 100_000)]
    readers: usize,
}

/// Observations of a phase.
const POINTS: usize = 200;
/// Part of a phase that is warm-up: memory pages are mapped at their first use.
const WARM_UP: f64 = 0.2;
/// A recording of this size has messages in it.
const RECORDED_BYTES: u64 = 10_000;
/// How long anything may take.
const PATIENCE: Duration = Duration::from_secs(60);

impl Args {
    /// Runs all phases and reports.
    pub fn run(self) -> anyhow::Result<()> {
        let model = std::fs::read(&self.model)
            .with_context(|| format!("cannot read {}", self.model.display()))
            .map_err(configuration)?;
        let testbed = Testbed::new("cycles")?;
        testbed.write("finger.twin", model)?;
        let readings = Sine::through_the_onset(1000.0, 40.0);
        let scene = readings.scene("finger", "finger.twin".as_ref(), "", &["nodes = \"all\"".into()]);
        let scene = testbed.write("scene.toml", scene)?;
        let mut programs = Programs::start(&testbed, &scene)?;
        let phases = [
            ("reloads", programs.reloads(self.reloads)?),
            ("readers", programs.readers(self.readers)?),
            ("restarts", programs.restarts(self.restarts)?),
        ];
        programs.stop()?;
        let mut wrong: Vec<String> = Vec::new();
        let mut report = serde_json::Map::new();
        for (name, phase) in phases {
            wrong.extend(phase.growing().map(|(what, slope)| format!("{name}: {what} grows: {slope:?}")));
            report.insert(name.to_owned(), phase.report());
        }
        report.insert("wrong".into(), json!(wrong));
        output::json(&report)?;
        anyhow::ensure!(wrong.is_empty(), "{}", wrong.join("; "));
        Ok(())
    }
}

/// Cycles from one observation to the next.
fn between_observations(cycles: usize) -> usize {
    cycles.div_ceil(POINTS).max(1)
}

/// Room for a series whose pages are in use from the beginning: this program is among those observed.
fn room() -> Vec<(f64, f64)> {
    let mut points = vec![(1.0, 1.0); POINTS + 1];
    points.clear();
    points
}

/// Observations of a repeated action.
struct Phase {
    cycles: usize,
    seconds: f64,
    series: BTreeMap<String, Vec<(f64, f64)>>,
}

impl Phase {
    /// Repeats `cycle` and observes; what it returns are names and values.
    fn run(
        cycles: usize,
        mut cycle: impl FnMut(usize) -> anyhow::Result<()>,
        mut observe: impl FnMut() -> Vec<(String, f64)>,
    ) -> anyhow::Result<Self> {
        let begin = Instant::now();
        let every = between_observations(cycles);
        let mut series: BTreeMap<String, Vec<(f64, f64)>> = BTreeMap::new();
        for number in 0..cycles {
            cycle(number)?;
            if number % every == 0 && number as f64 >= WARM_UP * cycles as f64 {
                for (name, value) in observe() {
                    series.entry(name).or_insert_with(room).push((number as f64, value));
                }
            }
        }
        Ok(Self { cycles, seconds: begin.elapsed().as_secs_f64(), series })
    }

    fn slopes(&self) -> impl Iterator<Item = (&String, Option<Slope>)> {
        self.series.iter().map(|(name, points)| (name, Slope::of(points)))
    }

    fn growing(&self) -> impl Iterator<Item = (&String, Slope)> {
        // A page of memory, or one file.
        let smallest = |name: &str| if name.ends_with("_kb") { 4.0 } else { 1.0 };
        let grown = move |(name, slope): &(&String, Slope)| slope.grows(self.cycles as f64, smallest(name));
        self.slopes().filter_map(|(name, slope)| Some((name, slope?))).filter(grown)
    }

    fn report(&self) -> Value {
        let ends = |points: &[(f64, f64)]| {
            let (first, last) = (points.first(), points.last());
            json!([first.map(|point| point.1), last.map(|point| point.1)])
        };
        let about = self.slopes().map(|(name, slope)| {
            let about = json!({ "first_and_last": ends(&self.series[name]), "per_cycle": slope });
            (name.clone(), about)
        });
        json!({
            "cycles": self.cycles,
            "seconds": self.seconds,
            "quantities": about.collect::<serde_json::Map<_, _>>(),
        })
    }
}

/// The programs.
struct Programs<'a> {
    testbed: &'a Testbed,
    scene: &'a Path,
    twin: Daemon,
    bridge: Daemon,
    recorder: Daemon,
    never: AtomicBool,
}

impl<'a> Programs<'a> {
    fn start(testbed: &'a Testbed, scene: &'a Path) -> anyhow::Result<Self> {
        let twin = testbed.daemon("twin", scene, &[])?;
        let bridge = testbed.daemon("bridge", scene, &[])?;
        std::fs::create_dir(testbed.path("recordings"))?;
        let mut command = testbed.command(&program("softtwin")?);
        command.args(["record", "--rotate-minutes", "1000", "--keep", "4", "--out"]);
        command.arg(testbed.path("recordings/run.mcap")).stdout(Stdio::null());
        let recorder = Daemon::start("recorder", &mut command)?;
        let programs = Self { testbed, scene, twin, bridge, recorder, never: AtomicBool::new(false) };
        // A recorder that has not begun is ended by a signal that it does not know yet.
        let end = Instant::now() + PATIENCE;
        let begun = |path: PathBuf| std::fs::metadata(path).is_ok_and(|file| file.len() > RECORDED_BYTES);
        while !programs.newest_recording()?.is_some_and(begun) {
            anyhow::ensure!(Instant::now() < end, "the recorder records nothing");
            std::thread::sleep(Duration::from_millis(5));
        }
        Ok(programs)
    }

    /// SIGHUP to all three, then wait for all three.
    fn reloads(&mut self, cycles: usize) -> anyhow::Result<Phase> {
        let watched =
            self.watched(&[("twin", &self.twin), ("bridge", &self.bridge), ("recorder", &self.recorder)]);
        Phase::run(
            cycles,
            |_| {
                let newest = self.newest_recording()?;
                for program in [&mut self.twin, &mut self.bridge, &mut self.recorder] {
                    program.signal(libc::SIGHUP)?;
                }
                self.twin.wait_for("reloaded", &self.never)?;
                self.bridge.wait_for("reloaded", &self.never)?;
                let end = Instant::now() + PATIENCE;
                while self.newest_recording()? == newest {
                    anyhow::ensure!(Instant::now() < end, "the recorder begins no new file");
                    std::thread::sleep(Duration::from_millis(5));
                }
                Ok(())
            },
            watched,
        )
    }

    /// Readers of states in this process, woken and not.
    fn readers(&mut self, cycles: usize) -> anyhow::Result<Phase> {
        let bus = self.testbed.bus()?;
        let topic = Topic::state("finger")?;
        let own = std::process::id().to_string();
        let mut watched = self.watched(&[("twin", &self.twin), ("bridge", &self.bridge)]);
        let observe = || {
            let mut all = watched();
            // This process keeps what the programs log, which is not the readers'.
            [&mut self.twin, &mut self.bridge, &mut self.recorder].into_iter().for_each(Daemon::forget_log);
            all.extend(usage("readers", &own));
            all
        };
        let cycle = |number: usize| {
            let waking = if number.is_multiple_of(2) { Waking::ByEvent } else { Waking::Never };
            let reader = StateReader::attach_as(&bus, &topic, waking)?;
            if waking == Waking::ByEvent {
                WakeSet::new([&reader as &dyn Wakeable]).wait(Duration::from_millis(100))?;
            }
            reader.newest()?;
            Ok(())
        };
        Phase::run(cycles, cycle, observe)
    }

    /// Restarts twin and bridge repeatedly while a recorder and a reader run. Between two observations the recorder begins a new
    /// file, because it keeps the index of a file in memory until its end.
    fn restarts(&mut self, cycles: usize) -> anyhow::Result<Phase> {
        let own = std::process::id().to_string();
        let bus = self.testbed.bus()?;
        let states = StateReader::open(&bus, &Topic::state("finger")?)?;
        let mut watched = self.watched(&[("recorder", &self.recorder)]);
        let observe = || {
            let mut all = watched();
            // Its memory holds the logs of the programs; what it has open does not grow.
            all.extend(usage("reader", &own).into_iter().filter(|(name, _)| !name.ends_with("_kb")));
            all
        };
        let (testbed, scene) = (self.testbed, self.scene);
        let (twin, bridge, recorder) = (&mut self.twin, &mut self.bridge, &mut self.recorder);
        let every = between_observations(cycles);
        let cycle = |number: usize| {
            if number.is_multiple_of(every) {
                recorder.signal(libc::SIGHUP)?;
            }
            let (role, daemon) =
                if number.is_multiple_of(2) { ("twin", &mut *twin) } else { ("bridge", &mut *bridge) };
            if number % 4 < 2 {
                daemon.kill()?
            } else {
                daemon.stop()?
            }
            *daemon = testbed.daemon(role, scene, &[])?;
            states.newest()?;
            Ok(())
        };
        Phase::run(cycles, cycle, observe)
    }

    /// Function that returns the present usage of the programs and their shared memory.
    fn watched(&self, programs: &[(&'static str, &Daemon)]) -> impl FnMut() -> Vec<(String, f64)> + use<> {
        let programs: Vec<(&str, String)> =
            programs.iter().map(|(name, daemon)| (*name, daemon.id().to_string())).collect();
        let (prefix, folder) = (self.testbed.domain().prefix, self.testbed.path("iox"));
        move || {
            let mut all: Vec<_> = programs.iter().flat_map(|(name, process)| usage(name, process)).collect();
            let entries = std::fs::read_dir("/dev/shm").into_iter().flatten().flatten();
            let shared = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(&prefix));
            all.push(("shared_memory_files".into(), shared.count() as f64));
            all.push(("management_files".into(), count_files(&folder) as f64));
            all
        }
    }

    fn newest_recording(&self) -> anyhow::Result<Option<PathBuf>> {
        let files = std::fs::read_dir(self.testbed.path("recordings"))?.flatten().map(|entry| entry.path());
        // By length first: the number behind 9999 has five digits.
        Ok(files.max_by_key(|path| (path.as_os_str().len(), path.clone())))
    }

    fn stop(mut self) -> anyhow::Result<()> {
        self.recorder.signal(libc::SIGINT)?;
        self.recorder.wait()?;
        self.bridge.stop()?;
        self.twin.stop()
    }
}

/// Own memory in kB and open files of a process.
fn usage(name: &str, process: &str) -> Vec<(String, f64)> {
    let memory = resources::status(process, "RssAnon").map(|kb| (format!("{name}.private_kb"), kb as f64));
    let open = open_files(process).map(|count| (format!("{name}.open_files"), count as f64));
    memory.into_iter().chain(open).collect()
}
