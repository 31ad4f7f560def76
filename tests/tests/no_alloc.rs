//! After its start the twin's loop does not allocate; a counting allocator verifies it. What is counted is
//! exactly the transport's small handle for each loaned sample, and nothing else.

use rom::inputs::Inputs;
use rom::memory::{Creep, InputMemory, Line, Memory, MemorySpec, Play, Slopes};
use rom::model::{BlockKind, Model};
use rom::rng::Rng;
use rom::session::{Gaps, Session};
use runtime::config::{Limits, Scene, Settings};
use runtime::load::load_scene;
use runtime::source::{Devices, Poll};
use runtime::twin::{Twin, event_channel};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::net::UdpSocket;
use std::sync::mpsc::sync_channel;
use std::time::{Duration, Instant};
use tests::{Stage, moving};
use wire::layout::{Marker, field_id, flags, regime};
use wire::{EstimateReader, FieldReader, SensorSample, SensorWriter, StateReader, Topic, now_ns};

struct Counting;

thread_local! {
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

// SAFETY: every call is passed on to the system's allocator unchanged; the counter does not allocate (const-initialised,
// without a destructor).
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.set(COUNT.get() + 1);
        // SAFETY: the caller's promises are the ones that `System` asks for.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        COUNT.set(COUNT.get() + 1);
        // SAFETY: as above.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Line, play and creep of the pressure.
fn memory() -> MemorySpec {
    let of = InputMemory {
        input: 0,
        range: [0.0, 0.06],
        line: Some(Line { fill_s: 0.2, empty_s: 0.5 }),
        orifice: None,
        play: vec![Play { threshold: 0.001, weight: 0.4 }],
        creep: vec![Creep { time_s: 3.0, weight: 0.1 }],
        slopes: Slopes { displacement_mm: 1000.0, ..Slopes::default() },
    };
    MemorySpec { inputs: vec![of], max_gap_s: 1.0 }
}

#[test]
fn twin_loop_allocates_only_the_transports_sample_handles_and_publishes_inputs_behind_the_memory() {
    let stage = Stage::new("alloc");
    let path = stage.finger("kind = \"simulate\"");
    let scene = Scene::load(&path).unwrap();
    let bus = stage.bus();
    let mut loaded = load_scene(&scene, &path).unwrap();
    let mut model = Model::from_bytes(&std::fs::read(&loaded[0].spec.model).unwrap()).unwrap();
    model.set_record(BlockKind::Memory, &memory()).unwrap();
    loaded[0].session = Session::new(&model, Gaps::Live).unwrap();
    let mut expected = Memory::new(memory()).unwrap();
    let (events, _reporter) = event_channel();
    let mut twin = Twin::start(&bus, loaded, &patient(), &events).unwrap();
    let mut sensor = SensorWriter::create(&bus, &Topic::sensor("finger").unwrap()).unwrap();
    let fields = FieldReader::open(&bus, &Topic::field("finger", None).unwrap()).unwrap();
    let states = StateReader::open(&bus, &Topic::state("finger").unwrap()).unwrap();
    let mut send_and_turn = |seq: u64| {
        // Rises through the onset, with every tenth reading a bad one.
        let pressure_mpa = if seq % 10 == 7 { f64::NAN } else { 0.06 * seq as f64 / 400.0 };
        let t_sensor_ns = now_ns();
        let sample =
            SensorSample { boot_id: 5, seq, t_sensor_ns, pressure_mpa, gap_mm: 30.0, ..Default::default() };
        sensor.publish(sample).unwrap();
        let allocations = allocations_of_turn(&mut twin);
        if pressure_mpa.is_finite() {
            expected.advance(t_sensor_ns, &Inputs::new(pressure_mpa, 30.0));
        }
        let state = states.newest().unwrap().expect("a state");
        let behind = expected.effective(&Inputs::new(pressure_mpa, 30.0)).pressure_mpa();
        assert_eq!(state.pressure_mpa.to_bits(), behind.to_bits(), "{seq}");
        assert!(f64::from(state.displacement_halfwidth_mm) > 999.0 * expected.spread()[0], "{seq}");
        drop(fields.newest().unwrap());
        allocations
    };
    // The first rounds connect the ports that were opened after the twin.
    let warm_up: u64 = (1..=20).map(&mut send_and_turn).sum();
    let steady: u64 = (21..=400).map(&mut send_and_turn).sum();
    // 342 good readings with a state and two fields each, 38 held ones with a state.
    let samples = 342 * 3 + 38;
    assert_eq!(steady, samples, "{steady} allocations for {samples} samples ({warm_up} while warming up)");
    let health = twin.health().next().unwrap();
    assert_eq!(health.received, 400);
    assert_eq!(health.count(wire::Outcome::HeldNotFinite), 40);
    assert_eq!(health.count(wire::Outcome::Published), 360);
}

/// Allocations of one iteration, without the handle of a health, which is due by the clock.
fn allocations_of_turn(twin: &mut Twin) -> u64 {
    let healths = |twin: &Twin| twin.health().map(|health| health.seq).sum::<u64>();
    let before = (COUNT.get(), healths(twin));
    twin.turn(Duration::from_millis(100));
    COUNT.get() - before.0 - (healths(twin) - before.1)
}

#[test]
fn session_of_a_learned_model_allocates_nothing() {
    let model = tests::learned_model();
    let mut session = Session::new(&model, Gaps::Live).unwrap();
    let mut out = session.evaluation();
    let before = COUNT.get();
    for k in 0..100 {
        let inputs = Inputs::new(0.001 * k as f64, f64::INFINITY).with(2, 0.03);
        session.step(25_000_000 * k, inputs, &mut out).unwrap();
        session.evaluator().evaluate(inputs, &mut out);
    }
    assert_eq!(COUNT.get() - before, 0);
}

/// Settings of a twin on a loaded machine, which misses no deadline.
fn patient() -> Settings {
    let limits = Limits { max_age_ms: 60_000.0, deadline_ms: Some(50_000.0), ..Limits::default() };
    Settings { limits, ..Settings::default() }
}

/// Bias of the gauge that the estimator is to find, MPa.
const BIAS_MPA: f64 = 0.004;

/// Place of the outer mass and force at each reading of a moving twin that swings, lands on the plate and leaves it. `seen` are those of a camera
/// and a load cell, for a scene that estimates.
fn moving_twin(label: &str, seen: Option<&[[f64; 4]]>) -> Vec<[f64; 4]> {
    let stage = Stage::with_model(label, moving::model_bytes());
    let path = stage.whole_finger("kind = \"simulate\"");
    let text = std::fs::read_to_string(&path).unwrap();
    let estimate = "[actuator.estimate]\npressure_bias_mpa = { prior = 0.0, sigma = 0.01 }\n[actuator.sigma]\npressure_mpa = 0.0005\n\
        gap_mm = 0.01\nforce_n = 0.002\nmarker_mm = 0.2\nmodel_force_n = 0.002\nmodel_mm = 0.05\n[[actuator.marker]]\nname = \"outer\"\nnode = 2\n";
    std::fs::write(&path, text + if seen.is_some() { estimate } else { "" }).unwrap();
    let scene = Scene::load(&path).unwrap();
    let bus = stage.bus();
    let loaded = load_scene(&scene, &path).unwrap();
    let (events, _reporter) = event_channel();
    let mut twin = Twin::start(&bus, loaded, &patient(), &events).unwrap();
    let mut sensor = SensorWriter::create(&bus, &Topic::sensor("finger").unwrap()).unwrap();
    let fields = FieldReader::open(&bus, &Topic::field("finger", None).unwrap()).unwrap();
    let states = StateReader::open(&bus, &Topic::state("finger").unwrap()).unwrap();
    let estimates = seen.map(|_| EstimateReader::open(&bus, &Topic::estimate("finger").unwrap()).unwrap());
    let begin_ns = now_ns() - 20_000_000_000;
    let (mut regimes, mut random, mut found) = ([0; 3], Rng::new(4), Vec::with_capacity(400));
    let mut normal = || (0..12).map(|_| random.uniform()).sum::<f64>() - 6.0;
    let mut allocations = [0; 2];
    for seq in 1..=400_u64 {
        let pressure_mpa = if seq % 100 < 40 { 0.02 } else { 0.18 };
        // Every 150th reading comes after a gap that is held, every 200th after one that is not.
        let gaps_ns = seq / 150 * 400_000_000 + seq / 200 * 1_100_000_000;
        let t_sensor_ns = begin_ns + seq * 5_000_000 + gaps_ns;
        let mut sample =
            SensorSample { boot_id: 5, seq, t_sensor_ns, pressure_mpa, gap_mm: 20.0, ..Default::default() };
        if let Some([x, y, z, force]) = seen.map(|seen| seen[seq as usize - 1]) {
            sample.pressure_mpa += BIAS_MPA + 0.0005 * normal();
            sample.measured_force_n = force + 0.002 * normal();
            (sample.marker_values, sample.markers_mm[0]) =
                (3, Marker { x: x + 0.2 * normal(), y: y + 0.2 * normal(), z: z + 0.2 * normal() });
        }
        sensor.publish(sample).unwrap();
        allocations[usize::from(seq > 20)] += allocations_of_turn(&mut twin);
        let state = states.newest().unwrap().unwrap();
        regimes[state.regime as usize] += 1;
        let field = fields.newest().unwrap().unwrap();
        let place = [field_id::X, field_id::Y, field_id::Z].map(|id| f64::from(field.field(id).unwrap()[2]));
        found.push([place[0], place[1], place[2], state.contact_force_n]);
        if let Some(estimates) = &estimates {
            let estimate = estimates.newest().unwrap().unwrap();
            assert_eq!(estimate.unknown_count, 3, "the bias, the load and its rate");
            let off = (estimate.values[0] - BIAS_MPA).abs();
            assert!(off < 4.0 * estimate.sigmas[0], "{seq}: {off} {}", estimate.sigmas[0]);
            assert!(estimate.alarm == 0 || seq < 400, "{estimate:?}");
            assert!(estimate.sigmas[0] < 0.005 || seq < 400, "{estimate:?}");
        }
    }
    let samples = 380 * if seen.is_some() { 3 } else { 2 };
    assert_eq!(allocations[1], samples, "{samples} samples, {} while warming up", allocations[0]);
    assert_eq!(twin.health().next().unwrap().count(wire::Outcome::Published), 400);
    let [free, contact] = [regime::FREE, regime::CONTACT].map(|number| regimes[number as usize]);
    assert!(free > 50 && contact > 50, "{free} free, {contact} in contact");
    found
}

/// A camera sees the marker 3 mm and the angle 4 degrees beside a learned model's: from then on the field is where the marker is, with narrower
/// half-widths, and the state has the measured angle.
#[test]
fn twin_of_a_learned_model_follows_what_is_measured_and_allocates_only_the_transports_sample_handles() {
    let model = tests::learned_model();
    let stage = Stage::with_model("followed", &model.to_bytes().unwrap());
    let path = stage.write(
        "followed.toml",
        "name = \"bench\"\n[[actuator]]\nname = \"arm\"\nmodel = \"beam.twin\"\nfollow = true\n\
         [actuator.inputs]\noutlet_mpa = \"measured\"\n[actuator.observables]\nangle_deg = { sigma = 0.1 }\n[[actuator.marker]]\nname = \"tip\"\nnode = 0\n\
         [actuator.source]\nkind = \"simulate\"\n[[actuator.output]]\nnodes = \"all\"\n",
    );
    let scene = Scene::load(&path).unwrap();
    let (bus, (events, _reporter)) = (stage.bus(), event_channel());
    let mut twin = Twin::start(&bus, load_scene(&scene, &path).unwrap(), &patient(), &events).unwrap();
    let mut sensor = SensorWriter::create(&bus, &Topic::sensor("arm").unwrap()).unwrap();
    let fields = FieldReader::open(&bus, &Topic::field("arm", None).unwrap()).unwrap();
    let states = StateReader::open(&bus, &Topic::state("arm").unwrap()).unwrap();
    let (mut free, begin_ns) = (Session::new(&model, Gaps::Live).unwrap(), now_ns() - 20_000_000_000);
    let mut evaluation = free.evaluation();
    let [tip_y, angle] = [0, 1].map(|field| model.learned_output(field, 0).unwrap());
    let (mut counted, mut widths) = (0, Vec::with_capacity(400));
    for seq in 1..=400_u64 {
        let t_s = 0.02 * seq as f64;
        let [pressure_mpa, outlet_mpa] = [0.05 - 0.05 * (1.3 * t_s).cos(), 0.03 - 0.03 * (2.9 * t_s).cos()];
        let t_sensor_ns = begin_ns + seq * 20_000_000;
        let inputs = Inputs::new(pressure_mpa, f64::INFINITY).with(2, outlet_mpa);
        free.step(t_sensor_ns, inputs, &mut evaluation).unwrap();
        let (truth_mm, truth_deg) =
            (evaluation.coefficients[tip_y] + 3.0, evaluation.coefficients[angle] + 4.0);
        let mut sample = SensorSample { boot_id: 5, seq, t_sensor_ns, pressure_mpa, ..Default::default() };
        assert!(sample.add_input("outlet_mpa", outlet_mpa));
        if seq > 100 {
            (sample.marker_values, sample.markers_mm[0]) = (1, Marker { y: truth_mm, ..Marker::ABSENT });
            assert!(sample.add_input("angle_deg", truth_deg));
        }
        sensor.publish(sample).unwrap();
        counted += if seq > 120 { allocations_of_turn(&mut twin) } else { 0 };
        if seq <= 120 {
            twin.turn(Duration::from_millis(100));
        }
        let state = states.newest().unwrap().unwrap();
        assert_eq!(state.flags & flags::FOLLOWED != 0, seq > 102, "{seq}");
        let off_deg = state.observables[0] - truth_deg;
        assert!((off_deg + 4.0 - state.observable_offsets[0]).abs() < 1e-9, "{seq}: {off_deg}");
        assert!(seq < 300 || off_deg.abs() < 0.3, "{seq}: {off_deg}");
        let y_mm = f64::from(fields.newest().unwrap().unwrap().field(field_id::Y).unwrap()[0]);
        let off_mm = y_mm - truth_mm;
        assert!(seq > 100 || (off_mm + 3.0).abs() < 1e-4, "{seq}: {off_mm}");
        assert!(seq < 300 || off_mm.abs() < 0.2, "{seq}: {off_mm}");
        widths.push(state.displacement_halfwidth_mm);
    }
    assert_eq!(counted, 2 * 280);
    assert!(widths[399] < 0.9 * widths[99], "{} {}", widths[99], widths[399]);
    // Beyond what was learned: a flag and a wider interval or none; farther out no state.
    for (k, pressure_mpa) in [(1_u64, 0.15), (2, 1.0)] {
        let t_sensor_ns = begin_ns + 8_000_000_000 + k * 20_000_000;
        let mut sample =
            SensorSample { boot_id: 5, seq: 400 + k, t_sensor_ns, pressure_mpa, ..Default::default() };
        assert!(sample.add_input("outlet_mpa", 0.03));
        sensor.publish(sample).unwrap();
        twin.turn(Duration::from_millis(100));
        let Some(state) = states.newest().unwrap() else {
            assert_eq!(k, 2);
            continue;
        };
        let width = state.displacement_halfwidth_mm;
        assert!(k == 1 && (width.is_nan() || width > widths[399]), "{k} {width}");
        assert!(state.flags & flags::OUTSIDE_DOMAIN != 0, "{k}");
    }
    assert_eq!(twin.health().next().unwrap().count(wire::Outcome::DroppedModel), 1);
    let refused = std::fs::read_to_string(&path).unwrap().replace("node = 0", "at_mm = [0.0, 0.0, 0.0]");
    std::fs::write(&path, refused).unwrap();
    assert!(load_scene(&Scene::load(&path).unwrap(), &path).is_err());
}

/// As above for a model with inertia; then with an estimator, which finds the bias of the gauge from the moving body and follows it.
#[test]
fn twin_loop_of_a_moving_model_allocates_only_the_transports_sample_handles() {
    let truth = moving_twin("moving", None);
    let found = moving_twin("estimating", Some(&truth));
    let y = |rows: &[[f64; 4]]| rows.iter().map(|row| row[1]).collect::<Vec<f64>>();
    let mut off: Vec<f64> = y(&found).iter().zip(y(&truth)).map(|(a, b)| (a - b).abs()).collect();
    off.sort_by(f64::total_cmp);
    // A few readings after a gap are contradicted before the motion is found again.
    assert!(off[200] < 0.1 && off[390] < 1.0, "{off:?} mm");
}

/// The bridge's loop asks its sources: what several sensors have said becomes readings without an allocation.
#[test]
fn source_of_several_sensors_does_not_allocate() {
    let folder = tempfile::tempdir().unwrap();
    let address = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let text = format!(
        "name = \"s\"\n[[actuator]]\nname = \"f\"\nmodel = \"m.twin\"\npace = \"board\"\n[actuator.sensors.board]\nkind = \"lines\"\n\
         udp = \"{address}\"\nvalues.pressure_mpa = {{ from = 1, filter = {{ median = 5 }} }}\n[actuator.sensors.camera]\nkind = \"lines\"\n\
         udp = \"{address}\"\nage_limit_ms = 1\nvalues.marker1_x_mm = {{ from = 1 }}\nvalues.gap_mm = {{ from = 2 }}\n"
    );
    std::fs::write(folder.path().join("scene.toml"), text).unwrap();
    let scene = Scene::load(&folder.path().join("scene.toml")).unwrap();
    let source = scene.actuators[0].open_source(&scene.folder, &Devices::default());
    let mut source = source.expect("sensors").unwrap();
    let (waker, wakes) = sync_channel(1);
    source.start(&waker).unwrap();
    let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
    let (mut readings, mut with_gap) = (0, 0);
    let end = Instant::now() + Duration::from_secs(20);
    while readings < 500 {
        assert!(Instant::now() < end, "{readings} readings only");
        sender.send_to(b"0.03; 40", address).unwrap();
        let _woken_or_not = wakes.recv_timeout(Duration::from_millis(1));
        let before = COUNT.get();
        let polled = source.poll(0.0);
        assert_eq!(COUNT.get() - before, 0, "allocations after {readings} readings");
        if let Poll::Reading(reading) = polled {
            readings += 1;
            with_gap += u32::from(reading.sample.gap_mm == 40.0);
        }
    }
    assert!(with_gap > 100, "{with_gap} of {readings} readings had a value of the other sensor");
}

#[test]
fn steps_of_a_session_do_not_allocate() {
    let model = Model::from_bytes(&moving::relaxing_bytes()).unwrap();
    for gaps in [Gaps::Live, Gaps::Recorded] {
        let mut session = Session::new(&model, gaps).unwrap();
        let mut out = session.evaluation();
        let readings = moving::readings(5);
        let before = COUNT.get();
        for reading in &readings {
            if reading.restarts {
                session.restart();
            }
            // Refused readings do not allocate either.
            let _ = session.step(reading.t_ns, Inputs::new(reading.pressure_mpa, 20.0), &mut out);
        }
        assert_eq!(COUNT.get(), before);
    }
}
