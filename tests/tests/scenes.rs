//! Scenes in one process: what is loaded, what is published, and that what a scene leaves out costs nothing.

use proptest::prelude::*;
use rom::inputs::Inputs;
use rom::model::BlockKind;
use rom::snapshots::RegimeKind;
use runtime::config::{OutsideDomain, Scene, Settings};
use runtime::explain::explain;
use runtime::load::{LoadedActuator, load_scene};
use runtime::source::Devices;
use runtime::twin::{Event, EventKind, Twin, event_channel};
use std::path::Path;
use std::sync::mpsc::Receiver;
use std::time::Duration;
use tests::{Stage, synthetic};
use wire::layout::{flags, regime};
use wire::{Bus, FieldReader, Outcome, SensorSample, SensorWriter, StateReader, Topic, now_ns};

fn load(stage: &Stage, text: &str) -> Vec<LoadedActuator> {
    let path = stage.write("scene.toml", text);
    let scene = Scene::load(&path).unwrap_or_else(|error| panic!("{error}"));
    load_scene(&scene, &path).unwrap_or_else(|error| panic!("{error}"))
}

fn actuator(extra: &str) -> String {
    format!("name = \"s\"\n[[actuator]]\nname = \"finger\"\nmodel = \"beam.twin\"\n{extra}")
}

fn blocks_of(loaded: &LoadedActuator, kind: RegimeKind) -> usize {
    let of = |block: BlockKind| match block {
        BlockKind::Mean { regime, .. } | BlockKind::Modes { regime, .. } => regime == kind,
        BlockKind::Undeformed(_)
        | BlockKind::UndeformedBy { .. }
        | BlockKind::Surface
        | BlockKind::Observables
        | BlockKind::HalfWidth { .. }
        | BlockKind::Inertia
        | BlockKind::Difference
        | BlockKind::Limit
        | BlockKind::Learned
        | BlockKind::Memory => false,
    };
    loaded.read.iter().filter(|block| of(block.kind)).count()
}

const ALL: &str = "[[actuator.output]]\nnodes = \"all\"\n";

#[test]
fn both_regimes_share_a_basis_and_unused_fields_are_not_loaded() {
    let stage = Stage::new("reach");
    let both = load(&stage, &actuator(ALL)).remove(0);
    assert_eq!(both.regimes, [RegimeKind::Free, RegimeKind::Contact]);
    assert_eq!(blocks_of(&both, RegimeKind::Free), 0);
    assert!(blocks_of(&both, RegimeKind::Contact) > 0);
    let out_of_reach = load(&stage, &actuator(&format!("gap_mm = 90.0\n{ALL}"))).remove(0);
    assert_eq!(out_of_reach.regimes, [RegimeKind::Free]);
    let below_the_sag =
        load(&stage, &actuator(&format!("gap_mm = {{ min = 8.0, max = 12.0 }}\n{ALL}"))).remove(0);
    assert_eq!(below_the_sag.regimes, [RegimeKind::Contact]);
    let state_only = load(&stage, &actuator("")).remove(0);
    assert!(state_only.read.is_empty(), "a state needs no basis: {:?}", state_only.read);
    let stress = load(&stage, &actuator("[[actuator.output]]\nfields = [\"von_mises\"]")).remove(0);
    assert_eq!(stress.read.len(), 2, "mean and modes of one field for both regimes: {:?}", stress.read);
    assert!(stress.read.iter().map(|block| block.bytes).sum::<u64>() < stress.file_block_bytes / 3);
}

#[test]
fn derived_field_requires_only_its_sources() {
    let stage = Stage::new("derived");
    let loaded = load(&stage, &actuator("[[actuator.output]]\nnodes = \"tip\"\nfields = [\"displacement\"]"))
        .remove(0);
    let output = &loaded.outputs[0];
    assert_eq!((output.reconstructor.rows(), output.reconstructor.field_count()), (10, 1));
    let undeformed =
        loaded.read.iter().filter(|block| matches!(block.kind, BlockKind::Undeformed(_))).count();
    assert_eq!((undeformed, loaded.read.len()), (3, 3 + 2 * 3), "three coordinates, for both regimes");
}

#[test]
fn nodes_are_selected_by_name_box_or_list() {
    let stage = Stage::new("nodes");
    let text = actuator(
        "[[actuator.output]]\nnodes = \"tip\"\n\
         [[actuator.output]]\nname = \"end\"\nnodes = { box = { min = [109.0, -1.0, -1.0], max = [111.0, 1.0, 99.0] } }\n\
         [[actuator.output]]\nname = \"three\"\nnodes = { list = [7, 0, 119] }\n",
    );
    let loaded = load(&stage, &text).remove(0);
    let rows: Vec<usize> = loaded.outputs.iter().map(|output| output.reconstructor.rows()).collect();
    let in_box = synthetic::mesh().iter().filter(|x| x[0] == 110.0 && x[1] == 0.0).count();
    assert_eq!(rows, [10, in_box, 3]);
    let empty = stage.write(
        "empty.toml",
        &actuator("[[actuator.output]]\nname = \"e\"\nnodes = { box = { min = [500.0, 0.0, 0.0], max = [501.0, 1.0, 1.0] } }"),
    );
    let error = load_scene(&Scene::load(&empty).unwrap(), &empty).unwrap_err().to_string();
    assert!(error.contains("no node lies in the box"), "{error}");
}

#[test]
fn explain_reports_regimes_bytes_and_times() {
    let stage = Stage::new("explain");
    let loaded = load(&stage, &actuator(&format!("gap_mm = 90.0\n{ALL}"))).remove(0);
    let explained = explain(&loaded);
    assert_eq!(explained.regimes, ["free"]);
    assert!(explained.read_bytes < explained.file_block_bytes);
    let output = &explained.outputs[0];
    assert_eq!((output.topic.as_str(), output.nodes), ("softtwin/finger/field", synthetic::NODES));
    assert_eq!(output.sample_bytes, 4 * 5 * synthetic::NODES as u64);
    assert!(output.us > explained.state_us && explained.state_us > 0.0);
}

/// A twin under the test's own hand.
struct Bench {
    bus: Bus,
    twin: Twin,
    events: Receiver<Event>,
}

impl Bench {
    fn start(stage: &Stage, text: &str) -> Self {
        Self::start_with(stage, text, &Settings::default())
    }

    fn start_with(stage: &Stage, text: &str, settings: &Settings) -> Self {
        Self::start_loaded(stage, load(stage, text), settings)
    }

    fn start_loaded(stage: &Stage, loaded: Vec<LoadedActuator>, settings: &Settings) -> Self {
        let bus = stage.bus();
        let (sender, events) = event_channel();
        let twin = Twin::start(&bus, loaded, settings, &sender).unwrap();
        Self { bus, twin, events }
    }

    fn sensor(&self, name: &str) -> SensorWriter {
        SensorWriter::create(&self.bus, &Topic::sensor(name).unwrap()).unwrap()
    }

    fn turn(&mut self) {
        self.twin.turn(Duration::from_millis(200));
    }

    fn count(&self, outcome: Outcome) -> u64 {
        self.twin.health().map(|health| health.count(outcome)).sum()
    }
}

fn reading(seq: u64, pressure_mpa: f64, gap_mm: f64) -> SensorSample {
    SensorSample { boot_id: 1, seq, t_sensor_ns: now_ns(), pressure_mpa, gap_mm, ..SensorSample::default() }
}

#[test]
fn newest_reading_wins_without_a_backlog() {
    for (backlog, published) in [(1, 1), (3, 3), (16, 5)] {
        let stage = Stage::new("backlog");
        let mut bench = Bench::start(&stage, &actuator(&format!("backlog = {backlog}\n{ALL}")));
        let fields = FieldReader::open(&bench.bus, &Topic::field("finger", None).unwrap()).unwrap();
        let mut sensor = bench.sensor("finger");
        for seq in 1..=5 {
            sensor.publish(reading(seq, 0.01 * seq as f64, 30.0)).unwrap();
        }
        bench.turn();
        let seqs: Vec<u64> =
            std::iter::from_fn(|| fields.next().unwrap()).map(|sample| sample.header().sensor_seq).collect();
        assert_eq!(seqs, (6 - published..=5).collect::<Vec<u64>>(), "backlog {backlog}");
        assert_eq!(bench.count(Outcome::DroppedSuperseded), 5 - published);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]
    /// Early and late stamps, stamps from the future, repeated and missing readings, invalid values, bursts: each reading that
    /// arrives has one outcome, and what was sent is what was received and what is missing.
    #[test]
    fn every_reading_is_in_one_class_and_the_counts_add_up(
        kinds in prop::collection::vec((0_u8..8, any::<bool>()), 1..50),
    ) {
        let stage = Stage::new("counts");
        let mut bench = Bench::start(&stage, &actuator("backlog = 3"));
        let mut sensor = bench.sensor("finger");
        let (mut seq, mut arrived, mut missing) = (1, 1, 0);
        sensor.publish(reading(1, 0.05, 30.0)).unwrap();
        for (kind, turn) in kinds {
            let repeated = kind == 0;
            if kind == 1 {
                missing += 2;
                seq += 2; // never sent
            }
            seq += u64::from(!repeated);
            let mut sample = reading(seq, 0.05, 30.0);
            match kind {
                2 => sample.t_sensor_ns -= 50_000_000,
                3 => sample.t_sensor_ns += 60_000_000_000,
                4 => sample.pressure_mpa = f64::NAN,
                5 => sample.pressure_mpa = 1e9,
                6 => sample.status = 7,
                _ => {}
            }
            sensor.publish(sample).unwrap();
            arrived += 1;
            if turn {
                bench.turn();
            }
        }
        sensor.publish(reading(seq + 1, 0.05, 30.0)).unwrap();
        arrived += 1;
        for _ in 0..3 {
            bench.turn();
        }
        let health = bench.twin.health().next().unwrap();
        prop_assert_eq!(health.outcomes.iter().sum::<u64>(), health.received, "{:?}", health.outcomes);
        // A burst may overwrite readings before the twin takes them: these are missing as well.
        prop_assert_eq!(health.received + health.missed, arrived + missing, "{:?}", health.outcomes);
    }
}

/// A field that the model cannot give is counted and reported as that, not as a refusal of shared memory; the state is sent.
#[test]
fn failed_reconstruction_has_outcome_and_event() {
    let stage = Stage::new("reconstruct");
    let free = load(&stage, &actuator(&format!("gap_mm = 90.0\n{ALL}"))).remove(0);
    let mut loaded = load(&stage, &actuator(ALL));
    // A basis for the free regime only: there is no field in contact.
    loaded[0].outputs = free.outputs;
    let mut bench = Bench::start_loaded(&stage, loaded, &Settings::default());
    let fields = FieldReader::open(&bench.bus, &Topic::field("finger", None).unwrap()).unwrap();
    let states = StateReader::open(&bench.bus, &Topic::state("finger").unwrap()).unwrap();
    let mut sensor = bench.sensor("finger");
    for (seq, pressure_mpa) in [(1, 0.001), (2, 0.06), (3, 0.06), (4, 0.001)] {
        sensor.publish(reading(seq, pressure_mpa, 30.0)).unwrap();
        bench.turn();
        let state = states.newest().unwrap().expect("the state is sent in any case");
        assert_eq!(state.sensor_seq, seq);
        assert_eq!(fields.next().unwrap().is_some(), pressure_mpa < 0.01, "reading {seq}");
    }
    assert_eq!(bench.count(Outcome::DroppedReconstruction), 2);
    assert_eq!((bench.count(Outcome::Published), bench.count(Outcome::DroppedNotSent)), (2, 0));
    let failures: Vec<(EventKind, u64)> =
        bench.events.try_iter().map(|event| (event.kind, event.value)).collect();
    assert!(failures.contains(&(EventKind::ReconstructionFailed, 2)), "{failures:?}");
    assert!(!failures.iter().any(|(kind, _)| *kind == EventKind::SendFailed), "{failures:?}");
}

/// A state carries all coefficients if the scene enables it.
#[test]
fn states_carry_coefficients_only_if_enabled() {
    let stress = "[[actuator.output]]\nfields = [\"von_mises\"]\n";
    let fields = |keys: &str| {
        let stage = Stage::new("coefficients");
        let text = actuator(&format!("{keys}{stress}"));
        let whole = load(&stage, &text).remove(0);
        let (mut expected, inputs) = (whole.session.evaluator().evaluation(), Inputs::new(0.05, 30.0));
        whole.session.evaluator().evaluate(inputs, &mut expected);
        let mut bench = Bench::start(&stage, &text);
        let states = StateReader::open(&bench.bus, &Topic::state("finger").unwrap()).unwrap();
        let fields = FieldReader::open(&bench.bus, &Topic::field("finger", None).unwrap()).unwrap();
        let mut sensor = bench.sensor("finger");
        sensor.publish(reading(1, 0.05, 30.0)).unwrap();
        bench.turn();
        let state = states.newest().unwrap().expect("a state");
        let expected: Vec<f32> = expected.coefficients.iter().map(|a| *a as f32).collect();
        (state.coefficients().to_vec(), expected, fields.next().unwrap().expect("a field").values().to_vec())
    };
    let (without, _, field) = fields("");
    let (with, expected, same) = fields("state = { coefficients = true }\n");
    assert!(without.is_empty() && with == expected && !with.is_empty(), "{without:?} {with:?}");
    assert_eq!(field, same, "the field does not depend on what the state carries");
}

#[test]
fn gap_outside_the_range_is_held_and_fixed_gap_replaces_measured() {
    let stage = Stage::new("range");
    let mut bench = Bench::start(&stage, &actuator("gap_mm = { min = 70.0, max = 90.0 }"));
    let mut sensor = bench.sensor("finger");
    sensor.publish(reading(1, 0.05, 80.0)).unwrap();
    sensor.publish(reading(2, 0.05, 30.0)).unwrap();
    bench.turn();
    assert_eq!((bench.count(Outcome::Published), bench.count(Outcome::HeldOutsideScene)), (1, 1));
    let stage = Stage::new("fixed");
    let mut bench = Bench::start(&stage, &actuator("gap_mm = 30.0"));
    let states = StateReader::open(&bench.bus, &Topic::state("finger").unwrap()).unwrap();
    let mut sensor = bench.sensor("finger");
    sensor.publish(reading(1, 0.05, f64::NAN)).unwrap();
    bench.turn();
    let state = states.newest().unwrap().expect("a state");
    assert_eq!((state.gap_mm, state.regime), (30.0, regime::CONTACT));
}

#[test]
fn readings_outside_the_training_range_follow_the_configured_policy() {
    for (policy, outcome, states_sent) in [
        (OutsideDomain::Answer, Outcome::Published, 2),
        (OutsideDomain::Hold, Outcome::HeldOutsideDomain, 2),
        (OutsideDomain::Refuse, Outcome::DroppedOutsideDomain, 1),
    ] {
        let stage = Stage::new("policy");
        let mut settings = Settings::default();
        settings.limits.outside_domain = policy;
        let mut bench = Bench::start_with(&stage, &actuator(""), &settings);
        let states = StateReader::open(&bench.bus, &Topic::state("finger").unwrap()).unwrap();
        let mut sensor = bench.sensor("finger");
        for (seq, pressure_mpa) in [(1, 0.05), (2, 0.12)] {
            sensor.publish(reading(seq, pressure_mpa, 30.0)).unwrap();
            bench.turn();
        }
        assert_eq!(bench.count(outcome), if policy == OutsideDomain::Answer { 2 } else { 1 }, "{policy:?}");
        let sent: Vec<_> = std::iter::from_fn(|| states.next().unwrap()).collect();
        assert_eq!(sent.len(), states_sent, "{policy:?}");
        let (last, pressure_mpa) =
            (sent.last().unwrap(), if policy == OutsideDomain::Answer { 0.12 } else { 0.05 });
        assert_eq!(last.pressure_mpa, pressure_mpa, "{policy:?}");
        assert_eq!(last.flags & flags::OUTSIDE_DOMAIN != 0, policy == OutsideDomain::Answer, "{policy:?}");
        assert_eq!(last.flags & flags::HELD != 0, policy == OutsideDomain::Hold, "{policy:?}");
    }
}

#[test]
fn several_actuators_run_in_one_twin() {
    let stage = Stage::new("two");
    let text = "name = \"two\"\n\
        [[actuator]]\nname = \"left\"\nmodel = \"beam.twin\"\n[[actuator.output]]\nnodes = \"tip\"\n\
        [[actuator]]\nname = \"right\"\nmodel = \"beam.twin\"\ngap_mm = 90.0\n[[actuator.output]]\n";
    let mut bench = Bench::start(&stage, text);
    let open = |name: &str| StateReader::open(&bench.bus, &Topic::state(name).unwrap()).unwrap();
    let (left, right) = (open("left"), open("right"));
    let (mut left_sensor, mut right_sensor) = (bench.sensor("left"), bench.sensor("right"));
    left_sensor.publish(reading(1, 0.06, 30.0)).unwrap();
    right_sensor.publish(reading(1, 0.06, 30.0)).unwrap();
    bench.turn();
    let (left, right) = (left.newest().unwrap().unwrap(), right.newest().unwrap().unwrap());
    assert_eq!((left.regime, right.regime), (regime::CONTACT, regime::FREE));
    assert!(left.contact_force_n > 0.1 && right.contact_force_n == 0.0);
}

#[test]
fn topic_keeps_its_rate() {
    let stage = Stage::new("rate");
    let mut bench = Bench::start(&stage, &actuator("[[actuator.output]]\nrate_hz = 100.0\n"));
    let fields = FieldReader::open(&bench.bus, &Topic::field("finger", None).unwrap()).unwrap();
    let mut sensor = bench.sensor("finger");
    let begin_ns = now_ns() - 500_000_000;
    for seq in 1..=40 {
        // 1 kHz by the stamps, whatever the clock says.
        sensor
            .publish(SensorSample { t_sensor_ns: begin_ns + seq * 1_000_000, ..reading(seq, 0.03, 40.0) })
            .unwrap();
        bench.turn();
    }
    let count = std::iter::from_fn(|| fields.next().unwrap()).count();
    assert_eq!((count, bench.count(Outcome::Published)), (4, 40));
}

#[test]
fn shipped_configuration_is_valid_and_lists_the_defaults() {
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../config");
    assert_eq!(Settings::load(&config.join("twin.toml")).unwrap(), Settings::default());
    let mut seen = 0;
    for entry in std::fs::read_dir(config.join("scenes")).unwrap() {
        let path = entry.unwrap().path();
        let scene = Scene::load(&path).unwrap_or_else(|error| panic!("{error}"));
        let devices = Devices::default();
        for source in scene.actuators.iter().filter_map(|one| one.open_source(&scene.folder, &devices)) {
            source.unwrap_or_else(|problems| panic!("{}: {problems:?}", path.display()));
        }
        seen += 1;
    }
    assert!(seen >= 3);
}

/// The scene in the sensor documentation loads, and its sensors open.
#[test]
fn documented_sensor_scene_is_valid() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let page = std::fs::read_to_string(root.join("docs/sensors.md")).unwrap();
    let text = page.split("```toml\n").nth(1).and_then(|rest| rest.split("```").next()).expect("a scene");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, text).unwrap();
    let scene = Scene::load(&path).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(scene.actuators[0].sensors.len(), 4);
    let source = scene.actuators[0].open_source(&scene.folder, &Devices::default()).expect("sensors");
    assert_eq!(source.unwrap().devices().len(), 4);
    // An example of every kind, there or in the shipped scene.
    let shipped = std::fs::read_to_string(root.join("config/scenes/bench.toml")).unwrap();
    for kind in ["modbus", "lines"] {
        assert!([text, &shipped].iter().any(|scene| scene.contains(&format!("kind = \"{kind}\""))), "{kind}");
    }
}
