//! The memory that long recordings take: rotated files of readings and states at 1 kHz, read as one recording.
//!
//! `SOFTTWIN_SECONDS=3600 cargo test --workspace --test all -- --nocapture recording_memory::` measures an hour (some GB of disk, minutes);
//! without it 5 s are recorded, so that what reads them is tried each time.

use recording::message::{EncodeJson, channel};
use recording::{Retention, RotateOptions, RotatingWriter};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;
use wire::layout::COEFFICIENTS_MAX;
use wire::{Payload, SensorSample, State};

/// Most that a program may take, MB.
const MOST_MB: u64 = 200;

/// Readings and states at 1 kHz, a new file each quarter of the time; a few samples are as large as any.
fn record(folder: &Path, seconds: u64) -> usize {
    let rotate = RotateOptions {
        max_bytes: None,
        max_time_ns: Some(seconds * 250_000_000),
        keep: Retention::default(),
    };
    let mut writer = RotatingWriter::create(&folder.join("run.mcap"), rotate).expect("a file");
    let sensor = channel(SensorSample::LAYOUT, "softtwin/finger/sensor");
    let state = channel(State::LAYOUT, "softtwin/finger/state");
    let mut bytes = Vec::new();
    for seq in 0..seconds * 1000 {
        let t_ns = 1_800_000_000_000_000_000 + seq * 1_000_000;
        let pressure_mpa = 0.035 + 0.03 * (seq as f64 * 1e-3).sin();
        let reading =
            SensorSample { seq, t_sensor_ns: t_ns, pressure_mpa, gap_mm: 40.0, ..SensorSample::default() };
        reading.view().encode(&mut bytes);
        writer.message(&sensor, seq as u32, t_ns, t_ns, &bytes).expect("written");
        let mut coefficients = [0.0; COEFFICIENTS_MAX];
        coefficients
            .iter_mut()
            .enumerate()
            .for_each(|(k, value)| *value = (seq as f32 * 1e-3).sin() * k as f32);
        let (t_sensor_ns, t_publish_ns) = (t_ns, t_ns + 50_000);
        let answer = State {
            seq,
            t_sensor_ns,
            t_publish_ns,
            pressure_mpa,
            gap_mm: 40.0,
            contact_force_n: 10.0 * pressure_mpa,
            coefficient_count: COEFFICIENTS_MAX as u32,
            coefficients,
            ..State::default()
        };
        answer.view().encode(&mut bytes);
        writer.message(&state, seq as u32, t_ns, t_ns, &bytes).expect("written");
    }
    writer.finish().expect("closed").files.len()
}

/// The largest resident memory of a program until it ends, or until it prints a line with `until`, MB.
fn largest_mb(mut child: Child, until: Option<&str>) -> u64 {
    let mut lines = child.stdout.take().map(|pipe| BufReader::new(pipe).lines());
    let status = format!("/proc/{}/status", child.id());
    let mut largest_kb = 0;
    let look = |largest_kb: &mut u64| {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let found = line.and_then(|line| line.trim().trim_end_matches(" kB").trim().parse().ok());
        *largest_kb = found.unwrap_or(0).max(*largest_kb);
    };
    if let Some(until) = until {
        let found =
            lines.as_mut().expect("a pipe").by_ref().map_while(Result::ok).any(|line| line.contains(until));
        assert!(found, "`{until}` was not printed");
        look(&mut largest_kb);
        child.kill().expect("running");
        child.wait().expect("gone");
        return largest_kb / 1024;
    }
    loop {
        look(&mut largest_kb);
        if let Some(ended) = child.try_wait().expect("our child") {
            assert!(ended.success(), "{ended}");
            return largest_kb / 1024;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn commands_read_a_long_recording_in_bounded_memory() {
    let seconds = std::env::var("SOFTTWIN_SECONDS").map_or(5, |text| text.parse().expect("seconds"));
    let folder = tempfile::tempdir().expect("a folder");
    let recordings = folder.path().join("recordings");
    std::fs::create_dir(&recordings).expect("a folder");
    assert_eq!(record(&recordings, seconds), 4, "files");
    let source = recordings.display().to_string();
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/pneunet/pneunet.twin");
    let model = model.display().to_string();
    let file = |name: &str| folder.path().join(name).display().to_string();
    let (tables, picture, npy) = (file("tables"), file("run.png"), file("run.npy"));
    let every = (seconds * 100).to_string();
    let commands: [(&[&str], Option<&str>); 5] = [
        (&["export", &source, "--out", &tables, "--key", "softtwin/*/sensor"], None),
        (&["export", &source, "--model", &model, "--every", &every, "--out", &npy], None),
        (&["draw", &source, "--out", &picture], None),
        (&["view", &model, "--recording", &source, "--port", "0"], Some("http://")),
        (&["replay", &source, "--actuator", "finger", "--speed", "1e6"], None),
    ];
    for (arguments, until) in commands {
        let child = Command::new(env!("CARGO_BIN_EXE_softtwin"))
            .args(arguments)
            .env("SOFTTWIN_DOMAIN", format!("recmem_{}", std::process::id()))
            .env("SOFTTWIN_ROOT", folder.path().join("iox"))
            .current_dir(folder.path())
            .stdout(if until.is_some() { Stdio::piped() } else { Stdio::null() })
            .spawn()
            .expect("it starts");
        let largest = largest_mb(child, until);
        println!("{seconds} s at 1 kHz: softtwin {}: {largest} MB", arguments[0]);
        assert!(largest <= MOST_MB, "softtwin {}: {largest} MB", arguments[0]);
    }
    let rows = std::fs::read_to_string(Path::new(&tables).join("softtwin.finger.sensor.csv"));
    assert_eq!(rows.map(|text| text.lines().count() as u64).unwrap_or_default(), seconds * 1000 + 1);
    let root = folder.path().join("iox").display().to_string();
    let domain = wire::Domain::of(Some(&format!("recmem_{}", std::process::id())), Some(root));
    domain.remove_leftovers().expect("removed");
}
