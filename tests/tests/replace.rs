//! Programs that are replaced or reloaded while readings stream: nothing is lost, nothing comes twice.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use tests::wait::{fresh, states, wait_for, wait_state, wait_until};
use tests::{Program, Stage};
use wire::layout::flags;
use wire::{Outcome, SensorReader, StateReader, Topic};

const STEADY: &str = r#"kind = "simulate"
rate_hz = 200.0
gap_mm = 30.0
profile = { shape = "sine", mean_mpa = 0.035, amplitude_mpa = 0.03, frequency_hz = 1.0 }"#;

/// A scene whose twin answers every reading, also those that waited while the machine was busy.
fn scene(stage: &Stage) -> PathBuf {
    let path = stage.finger(STEADY);
    let text = std::fs::read_to_string(&path).unwrap();
    stage
        .write("finger.toml", &text.replace("model = \"beam.twin\"", "model = \"beam.twin\"\nbacklog = 1000"))
}

fn take_over(stage: &Stage, scene: &Path) -> Program {
    Program::daemon(stage, &["twin", "--take-over", "--scene", &scene.display().to_string()])
}

/// The answers to readings: how often each one came, by its number, and the longest time between two.
#[derive(Default)]
struct Answers {
    counts: BTreeMap<u64, u32>,
    runs: Vec<u64>,
    /// Longest age of an answer when it was sent: of the first one of a twin, and of the others.
    first_ns: u64,
    others_ns: u64,
}

impl Answers {
    fn take(&mut self, reader: &StateReader) {
        while let Some(state) = reader.next().unwrap() {
            if state.outcome != Outcome::Published.code() || state.flags & flags::STALE != 0 {
                continue;
            }
            *self.counts.entry(state.sensor_seq).or_default() += 1;
            let longest = if self.runs.contains(&state.boot_id) {
                &mut self.others_ns
            } else {
                self.runs.push(state.boot_id);
                &mut self.first_ns
            };
            *longest = (*longest).max(state.age_ns);
        }
    }

    /// Takes answers until there are `more` of them.
    fn take_more(&mut self, reader: &StateReader, more: usize) {
        let enough = self.counts.len() + more;
        wait_for(reader, "more answers", |reader| {
            self.take(reader);
            (self.counts.len() >= enough).then_some(())
        });
    }

    fn assert_each_once(&self) {
        let (first, last) = (self.counts.keys().next().unwrap(), self.counts.keys().last().unwrap());
        let missing: Vec<u64> = (*first..=*last).filter(|seq| !self.counts.contains_key(seq)).collect();
        let twice: Vec<_> = self.counts.iter().filter(|(_, count)| **count != 1).collect();
        assert!(missing.is_empty() && twice.is_empty(), "missing {missing:?}, not once {twice:?}");
    }
}

#[test]
fn a_new_twin_takes_over_and_no_reading_is_lost_or_answered_twice() {
    let stage = Stage::new("takeover");
    let scene = scene(&stage);
    let mut old = Program::twin(&stage, &scene);
    let _bridge = Program::bridge(&stage, &scene);
    let reader = states(&stage.bus());
    let mut answers = Answers::default();
    answers.take_more(&reader, 20);
    for _ in 0..5 {
        let mut new = take_over(&stage, &scene);
        new.wait_for("the topics are taken over");
        let (status, said) = old.end();
        assert_eq!(status.code(), Some(3), "{said:?}");
        assert!(said.iter().any(|line| line.contains("another twin has taken over")), "{said:?}");
        answers.take_more(&reader, 100);
        old = new;
    }
    answers.assert_each_once();
    assert_eq!(answers.runs.len(), 6, "six twins, one after the other");
    let ms = |ns: u64| ns as f64 * 1e-6;
    let (first, others) = (ms(answers.first_ns), ms(answers.others_ns));
    println!(
        "oldest first answer of a twin: {first:.2} ms, of the others: {others:.2} ms, at 5 ms a reading"
    );
    // What only one program can have comes along: answers to questions, the reload.
    wait_until("an answer", || {
        let (status, _) =
            Program::tool(&stage, &["get", "softtwin/finger/pressure?force_n=0.01;gap_mm=30"]).end();
        status.success().then_some(())
    });
    old.signal(libc::SIGHUP);
    old.wait_for("reloaded");
    let (status, said) = old.stop();
    assert!(status.success(), "{said:?}");
}

#[test]
fn without_a_twin_or_from_a_dead_one_it_is_an_ordinary_start() {
    let stage = Stage::new("takenone");
    let scene = scene(&stage);
    let mut first = take_over(&stage, &scene);
    first.wait_for("ready:");
    first.kill();
    let mut second = take_over(&stage, &scene);
    second.wait_for("ready:");
    let _bridge = Program::bridge(&stage, &scene);
    wait_state(&states(&stage.bus()), "a fresh state", fresh);
    // A second twin that does not ask is refused as ever.
    let (status, said) = Program::daemon(&stage, &["twin", "--scene", &scene.display().to_string()]).ended();
    assert_eq!(status.code(), Some(1), "{said:?}");
    assert!(said.iter().any(|line| line.contains("already publishes")), "{said:?}");
}

/// Locks are the steps of the protocol: the new twin is killed at each of its calls for one.
#[test]
fn a_new_twin_killed_at_any_step_leaves_the_old_one_or_can_be_started_again() {
    let stage = Stage::new("takekill");
    let scene = scene(&stage);
    let mut old = Program::twin(&stage, &scene);
    let _bridge = Program::bridge(&stage, &scene);
    let reader = states(&stage.bus());
    let (mut killed, mut survived, mut number) = (0, 0, 1);
    while survived == 0 {
        let inject = format!("inject=flock:signal=SIGKILL:when={number}");
        let line =
            ["softtwind", "twin", "--take-over", "--scene", &scene.display().to_string()].map(String::from);
        let line: Vec<&str> = line.iter().map(String::as_str).collect();
        let tracing = ["-o", "/dev/null", "-e", "trace=flock", "-e", &inject];
        let new = Program::traced(&stage, &tracing, &line);
        let (code, ready, said) = new.run_and_stop("the topics are taken over", Duration::from_millis(300));
        match code {
            None => killed += 1,
            Some(_) => survived += 1,
        }
        // The old one serves on, or it was told that it is replaced: then the manager starts the new one again.
        if !serves(&reader) {
            let (status, old_said) = old.end();
            assert_eq!(
                status.code(),
                Some(3),
                "step {number}: {old_said:?}; the new one ({ready}): {said:?}"
            );
            old = take_over(&stage, &scene);
            old.wait_for("ready:");
            assert!(serves(&reader), "step {number}: nobody serves");
        }
        number += if number < 30 { 3 } else { 8 };
        assert!(number < 500, "the new twin never survives");
    }
    assert!(killed >= 5, "{killed} kills only");
}

/// Whether fresh states come: within 2 s, because a state from before may still wait.
fn serves(reader: &StateReader) -> bool {
    while reader.next().unwrap().is_some() {}
    let end = Instant::now() + Duration::from_secs(2);
    let mut seen = 0;
    while Instant::now() < end && seen < 5 {
        while let Some(state) = reader.next().unwrap() {
            seen += u32::from(fresh(&state));
        }
        std::thread::yield_now();
    }
    seen >= 5
}

#[test]
fn an_old_twin_killed_at_any_moment_is_replaced() {
    let stage = Stage::new("oldkill");
    let scene = scene(&stage);
    let _bridge = Program::bridge(&stage, &scene);
    let mut old = Program::twin(&stage, &scene);
    let reader = states(&stage.bus());
    for round in 0..8u32 {
        let mut new = take_over(&stage, &scene);
        // From its first lines of the log to the end of the take-over.
        let begin = Instant::now();
        let moment = Duration::from_millis(8) * round;
        wait_until("the moment", || (begin.elapsed() >= moment).then_some(()));
        old.kill();
        new.wait_for("ready:");
        assert!(serves(&reader), "round {round}");
        old = new;
    }
}

#[test]
fn reloaded_bridge_replaces_changed_sources_and_continues_numbers() {
    let stage = Stage::new("bridgehup");
    let scene = stage.finger(STEADY);
    let mut bridge = Program::bridge(&stage, &scene);
    let readings = SensorReader::open(&stage.bus(), &Topic::sensor("finger").unwrap()).unwrap();
    let next = |what: &str, wanted: &dyn Fn(f64) -> bool| {
        wait_for(&readings, what, |readings| {
            let reading = readings.next().unwrap()?;
            wanted(reading.gap_mm).then_some(reading)
        })
    };
    let first = next("a reading", &|gap_mm| gap_mm == 30.0);
    bridge.signal(libc::SIGHUP);
    bridge.wait_for("no source has changed");

    let text = std::fs::read_to_string(&scene).unwrap();
    std::fs::write(&scene, text.replace("gap_mm = 30.0", "gap_mm = 35.0")).unwrap();
    bridge.signal(libc::SIGHUP);
    bridge.wait_for("sources of finger replaced");
    let mut last = first;
    let changed = wait_for(&readings, "the other gap", |readings| {
        while let Some(reading) = readings.next().unwrap() {
            assert_eq!((reading.boot_id, reading.seq), (last.boot_id, last.seq + 1), "numbers go on");
            last = reading;
            if reading.gap_mm == 35.0 {
                return Some(reading);
            }
        }
        None
    });
    assert!(changed.seq > first.seq);

    // What is wrong, and what cannot change while a bridge runs, is refused, and the readings go on.
    for (wrong, why) in [("kind = \"simulat\"", "refused"), ("# no source\n", "start the bridge anew")] {
        let broken = match wrong {
            "# no source\n" => text.replace("[actuator.source]", "[actuator.sauce]"),
            _ => text.replace("kind = \"simulate\"", wrong),
        };
        let broken = if wrong.starts_with('#') {
            let (head, tail) = broken.split_once("[actuator.sauce]").unwrap();
            let (_, outputs) = tail.split_once("[[actuator.output]]").unwrap();
            format!("{head}[[actuator.output]]{outputs}")
        } else {
            broken
        };
        std::fs::write(&scene, broken).unwrap();
        bridge.signal(libc::SIGHUP);
        let line = bridge.wait_for("reload refused");
        assert!(line.contains(why), "{line}");
        next("a reading", &|gap_mm| gap_mm == 35.0);
    }
    let (status, said) = bridge.stop();
    assert!(status.success(), "{said:?}");
}

#[test]
fn recorder_begins_a_new_file_on_sighup_without_loss() {
    let stage = Stage::new("recordhup");
    let _bridge = Program::bridge(&stage, &stage.finger(STEADY));
    let folder = stage.path("recordings");
    std::fs::create_dir(&folder).unwrap();
    let out = folder.join("run.mcap").display().to_string();
    let mut recorder = Program::tool(&stage, &["record", "--out", &out, "--rotate-minutes", "60", "--json"]);
    let recorded = || recording::Series::open(&folder).ok().map(|series| sequence(&series));
    wait_until("readings", || recorded().filter(|seen| seen.len() > 50));
    for files in 2..5 {
        recorder.signal(libc::SIGHUP);
        wait_until("a new file", || (std::fs::read_dir(&folder).unwrap().count() == files).then_some(()));
        let before = recorded().map_or(0, |seen| seen.len());
        wait_until("more readings", || recorded().filter(|seen| seen.len() > before + 20));
    }
    recorder.signal(libc::SIGINT);
    let (status, said) = recorder.end();
    assert!(status.success(), "{said:?}");
    let seen = recorded().unwrap();
    assert!(seen.windows(2).all(|pair| pair[1] == pair[0] + 1), "{seen:?}");
    assert!(seen.len() > 100, "{} readings", seen.len());
}

/// Numbers of the recorded readings.
fn sequence(series: &recording::Series) -> Vec<u64> {
    use recording::ReadItems;
    let mut reader = series.reader();
    let mut seen = Vec::new();
    // A file that was just begun has no head yet.
    while let Ok(Some(item)) = reader.next_item() {
        if let recording::Item::Message(message) = item
            && message.channel.topic == "softtwin/finger/sensor"
        {
            seen.push(recording::message::decode_reading(&message.data).unwrap().seq);
        }
    }
    seen
}
