//! Offsets that follow measured outputs: a running twin has those of `compare --follow`, for markers, angles and forces alike.

use formats::log::{LogColumn, Recording};
use rom::model::Model;
use rom::rng::Rng;
use runtime::config::{Limits, Scene, Settings};
use runtime::load::load_scene;
use runtime::twin::{Twin, event_channel};
use std::time::Duration;
use tests::{Program, Stage};
use train::comparison::{ComparedOutput, SensorBiases, compare};
use wire::layout::{Marker, flags};
use wire::{Outcome, SensorSample, SensorWriter, State, StateReader, Topic, now_ns};

const SCENE: &str = r#"
name = "bench"
[[actuator]]
name = "arm"
model = "beam.twin"
follow = true
backlog = 1
[actuator.inputs]
outlet_mpa = "measured"
[actuator.observables]
angle_deg = { sigma = 0.1 }
force_n = { sigma = 0.05 }
[[actuator.marker]]
name = "tip"
node = 0
[actuator.state]
coefficients = true
[actuator.source]
kind = "simulate"
"#;

const OUTPUTS: [&str; 3] = ["tip_y_mm", "angle_deg", "force_n"];
const ROWS: usize = 300;
/// Offsets at the first row.
const OFFSETS: [f64; 3] = [3.0, -4.0, 0.6];

/// A run of the bench behind [`tests::learned_model_with_force`] with other offsets, which wander: rows at uneven times, of which the sensors miss
/// some, one all of them for a while.
fn recording(seed: u64) -> Recording {
    let mut random = Rng::new(seed);
    let (mut time_ns, mut behind) = (0_u64, 0.0);
    let (mut time_s, mut columns) = (Vec::new(), vec![Vec::new(); 5]);
    let mut offsets = OFFSETS;
    for row in 0..ROWS {
        let step_ns = 1_000_000 * (5 + (30.0 * random.uniform()) as u64);
        time_ns += if row > 0 { step_ns } else { 0 };
        let t_s = 1e-9 * time_ns as f64;
        let inputs = [0.05 - 0.05 * (1.3 * t_s).cos(), 0.03 - 0.03 * (2.9 * t_s).cos()];
        behind += (1.0 - f64::exp(-1e-9 * step_ns as f64 / 0.3)) * (inputs[0] - inputs[1] - behind);
        time_s.push(t_s);
        columns.iter_mut().zip(inputs).for_each(|(column, value)| column.push(value));
        let truth = [200.0 * behind, 900.0 * behind * behind, 30.0 * behind];
        for (at, (column, value)) in columns[2..].iter_mut().zip(truth).enumerate() {
            offsets[at] *= 1.0 + 0.01 * random.normal();
            let is_seen = random.uniform() > 0.3 && !(100..140).contains(&row) && (at != 1 || row > 50);
            column.push(if is_seen { value + offsets[at] } else { f64::NAN });
        }
    }
    let names = ["pressure_mpa", "outlet_mpa"].into_iter().chain(OUTPUTS);
    let mut series = names.zip(columns).map(|(name, values)| LogColumn { name: name.into(), values });
    let inputs = series.by_ref().take(2).collect();
    Recording { start_s: 0.0, time_s, inputs, outputs: series.collect(), remarks: Vec::new() }
}

/// A twin of the scene gets the rows as readings, some at a time; with bad ones among them whose measured outputs must not count. Returns the
/// states that it publishes.
fn played(stage: &Stage, scene: &str, recording: &Recording, at_once: usize, with_bad: bool) -> Vec<State> {
    let path = stage.write("following.toml", scene);
    let scene = Scene::load(&path).unwrap();
    let (bus, (events, _reporter)) = (stage.bus(), event_channel());
    let limits = Limits { max_age_ms: 600_000.0, deadline_ms: Some(600_000.0), ..Limits::default() };
    let settings = Settings { limits, ..Settings::default() };
    let mut twin = Twin::start(&bus, load_scene(&scene, &path).unwrap(), &settings, &events).unwrap();
    let mut sensor = SensorWriter::create(&bus, &Topic::sensor("arm").unwrap()).unwrap();
    let states = StateReader::open(&bus, &Topic::state("arm").unwrap()).unwrap();
    let begin_ns = now_ns() - 100_000_000_000;
    let (mut seq, mut bad, mut found) = (0, 0, Vec::new());
    let mut publish = |sample: SensorSample| {
        seq += 1;
        sensor.publish(SensorSample { boot_id: 5, seq, ..sample }).unwrap();
    };
    for row in 0..ROWS {
        let t_ns = |row: usize| begin_ns + (1e9 * recording.time_s[row]).round() as u64;
        let [pressure_mpa, outlet_mpa] = [0, 1].map(|at| recording.inputs[at].values[row]);
        let [tip_y_mm, angle_deg, force_n] = [0, 1, 2].map(|at| recording.outputs[at].values[row]);
        let mut sample = SensorSample { t_sensor_ns: t_ns(row), pressure_mpa, ..SensorSample::default() };
        assert!(sample.add_input("outlet_mpa", outlet_mpa) && sample.add_input("angle_deg", angle_deg));
        // The force comes by its name or as the load cell's.
        if row % 2 == 0 {
            assert!(sample.add_input("force_n", force_n));
        } else {
            sample.measured_force_n = force_n;
        }
        (sample.marker_values, sample.markers_mm[0]) = (3, Marker { y: tip_y_mm, ..Marker::ABSENT });
        if with_bad && row % 3 == 1 {
            let mut wrong = sample;
            wrong.inputs[1..].fill(1e3);
            (wrong.measured_force_n, wrong.markers_mm[0].y) = (1e3, 1e3);
            let last_ns = t_ns(row - 1);
            match row / 3 % 3 {
                0 => (wrong.pressure_mpa, wrong.t_sensor_ns) = (f64::NAN, last_ns + 1),
                1 => wrong.t_sensor_ns = last_ns - 1,
                _ => wrong.t_sensor_ns = last_ns,
            }
            publish(wrong);
            bad += 1;
        }
        publish(sample);
        if row % at_once == at_once - 1 {
            twin.turn(Duration::from_millis(100));
            while let Some(state) = states.next().unwrap() {
                found.extend((state.outcome == Outcome::Published.code()).then_some(state));
            }
        }
    }
    let health = twin.health().next().unwrap();
    let refused = [Outcome::HeldNotFinite, Outcome::DroppedBackInTime].map(|outcome| health.count(outcome));
    assert_eq!(refused.iter().sum::<u64>(), bad);
    found
}

/// Rows before which an output was measured at least twice: the first value stands for an unknown time.
fn is_followed(recording: &Recording, row: usize) -> bool {
    let count = |series: &LogColumn| series.values[..row].iter().filter(|value| value.is_finite()).count();
    recording.outputs.iter().any(|series| count(series) >= 2)
}

fn check(model: &Model, recording: &Recording, states: &[State]) {
    let following = compare(model, recording, SensorBiases::default(), Some(0.0)).unwrap().series;
    let free = compare(model, recording, SensorBiases::default(), None).unwrap().series;
    assert_eq!(states.len(), ROWS);
    let output = |series: &[ComparedOutput], name: &str, row: usize| {
        let output = series.iter().find(|output| output.name == name).unwrap();
        (output.predicted[row], output.half_width[row])
    };
    let tip = model.learned_output(model.header.coordinate_field(1).unwrap(), 0).unwrap();
    for (row, state) in states.iter().enumerate() {
        assert_eq!(state.flags & flags::FOLLOWED != 0, is_followed(recording, row), "{row}");
        let [tip_mm, tip_width_mm] = [state.coefficients()[tip], state.displacement_halfwidth_mm];
        let (predicted, half_width) = output(&following, "tip_y_mm", row);
        assert_eq!(f64::from(tip_mm), predicted, "{row}");
        assert_eq!(
            tip_width_mm.to_bits(),
            (half_width as f32).to_bits(),
            "{row}: {tip_width_mm} {half_width}"
        );
        let named: Vec<(String, f64, f64)> = state.observables().collect();
        assert_eq!(named.iter().map(|(name, ..)| name.as_str()).collect::<Vec<_>>(), OUTPUTS[1..]);
        for ((name, value, width), offset) in named.iter().zip(state.observable_offsets) {
            // `compare` reconstructs fields, which are f32.
            let (predicted, half_width) = output(&following, name, row);
            assert_eq!(f64::from(*value as f32), predicted, "{row} {name}");
            assert_eq!(width.to_bits(), half_width.to_bits(), "{row} {name}: {width} {half_width}");
            let of_free = value - offset - output(&free, name, row).0;
            assert!(of_free.abs() < 1e-5, "{row} {name}: {of_free}");
        }
    }
    let offsets = &states[ROWS - 1].observable_offsets;
    for (offset, truth) in offsets.iter().zip(&OFFSETS[1..]) {
        assert!((offset / truth - 1.0).abs() < 0.6, "{offset} {truth}");
    }
}

#[test]
fn recording_played_live_has_the_offsets_of_compare_follow() {
    let model = tests::learned_model_with_force();
    let stage = Stage::with_model("following", &model.to_bytes().unwrap());
    for seed in 1..=4 {
        let recording = recording(seed);
        let plain = played(&stage, SCENE, &recording, 1, false);
        check(&model, &recording, &plain);
        // Readings that are refused change nothing, and a twin that answers every reading follows each of them.
        check(&model, &recording, &played(&stage, SCENE, &recording, 1, true));
        let backlog = SCENE.replace("backlog = 1", "backlog = 16");
        check(&model, &recording, &played(&stage, &backlog, &recording, 6, true));
    }
}

#[test]
fn scene_that_follows_what_the_model_has_no_output_for_is_refused() {
    let learned = Stage::with_model("unfollowed", &tests::learned_model_with_force().to_bytes().unwrap());
    let elements = Stage::new("unfollowed-mesh");
    let (observables, marker) = (
        "angle_deg = { sigma = 0.1 }\nforce_n = { sigma = 0.05 }\n",
        "[[actuator.marker]]\nname = \"tip\"\nnode = 0\n",
    );
    let nothing = SCENE.replace(observables, "").replace(marker, "");
    for (stage, scene, expected) in [
        (
            &elements,
            nothing.replace("outlet_mpa = \"measured\"\n", ""),
            ["follow", "learned from measurements"],
        ),
        (&learned, nothing, ["follow", "angle_deg, force_n"]),
        (&learned, SCENE.replace("angle_deg", "bend_deg"), ["observables.bend_deg", "angle_deg, force_n"]),
        (&learned, SCENE.replace("node = 0", "node = 1"), ["marker `tip`", "`node = 0` for tip"]),
    ] {
        let path = stage.write("refused.toml", &scene).display().to_string();
        let (status, said) = Program::daemon(stage, &["twin", "--scene", &path]).ended();
        let said = said.join("\n");
        assert_eq!(status.code(), Some(78), "{said}");
        assert!(
            expected.iter().all(|expected| said.contains(expected)) && said.contains("refused.toml"),
            "{said}"
        );
    }
}
