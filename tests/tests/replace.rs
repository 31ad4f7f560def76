//! Programs that reload while readings stream, and a second twin.

use tests::wait::{fresh, states, wait_for, wait_state, wait_until};
use tests::{Program, Stage};
use wire::{SensorReader, Topic};

const STEADY: &str = r#"kind = "simulate"
rate_hz = 200.0
gap_mm = 30.0
profile = { shape = "sine", mean_mpa = 0.035, amplitude_mpa = 0.03, frequency_hz = 1.0 }"#;

#[test]
fn second_twin_of_a_scene_is_refused() {
    let stage = Stage::new("second");
    let scene = stage.finger(STEADY);
    let first = Program::twin(&stage, &scene);
    let (status, said) = Program::daemon(&stage, &["twin", "--scene", &scene.display().to_string()]).ended();
    assert_eq!(status.code(), Some(1), "{said:?}");
    assert!(said.iter().any(|line| line.contains(&format!("process {}", first.id()))), "{said:?}");
    // A killed twin leaves its topics free.
    first.kill();
    let _second = Program::twin(&stage, &scene);
    let _bridge = Program::bridge(&stage, &scene);
    wait_state(&states(&stage.bus()), "a fresh state", fresh);
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

    // An error in the scene and a removed source are refused, and the readings continue.
    let (head, tail) = text.split_once("[actuator.source]").unwrap();
    let (_, outputs) = tail.split_once("[[actuator.output]]").unwrap();
    let without_source = format!("{head}[[actuator.output]]{outputs}");
    for wrong in [text.replace("kind = \"simulate\"", "kind = \"simulat\""), without_source] {
        std::fs::write(&scene, wrong).unwrap();
        bridge.signal(libc::SIGHUP);
        bridge.wait_for("reload refused");
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
    let recorded = || recording::RecordingFiles::open(&folder).ok().map(|series| sequence(&series));
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
fn sequence(series: &recording::RecordingFiles) -> Vec<u64> {
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
