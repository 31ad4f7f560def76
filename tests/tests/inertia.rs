//! A twin of a model with inertia as a real process: it swings as `softtwin predict` does, and gaps, restarts and loads outside of
//! the training range have the documented outcomes.

use serde_json::Value;
use std::path::Path;
use tests::moving::{self, LOAD, REST};
use tests::wait::{states, wait_for, wait_state};
use tests::{Program, Stage};
use wire::layout::{field_id, flags, regime};
use wire::{Bus, FieldReader, Outcome, SensorSample, SensorWriter, State, StateReader, Topic, now_ns};

/// Time between two readings, ns.
const STEP_NS: u64 = 5_000_000;
const GAP_MM: f64 = 20.0;

/// Scene of the moving finger, its settings, and its twin.
fn stage(label: &str) -> Stage {
    stage_of(label, moving::model_bytes())
}

fn stage_of(label: &str, model: &[u8]) -> Stage {
    let stage = Stage::with_model(label, model);
    stage.write(
        "finger.toml",
        "name = \"finger\"\n[[actuator]]\nname = \"finger\"\nmodel = \"beam.twin\"\nbacklog = 4\n[actuator.source]\nkind = \"simulate\"\n\
         gap_mm = 20.0\n[[actuator.output]]\nnodes = \"all\"\n",
    );
    // A loaded machine must not make readings too old, and their stamps are not the time of sending them.
    stage.write("twin.toml", "[limits]\nmax_age_ms = 60000.0\ndeadline_ms = 50000.0\n");
    stage
}

fn twin(stage: &Stage) -> Program {
    let mut twin = Program::daemon(stage, &["twin", "--scene", "finger.toml", "--config", "twin.toml"]);
    twin.wait_for("ready:");
    twin
}

/// Readings of one run of a bridge, each sent when the one before it has been answered.
struct Readings {
    sensor: SensorWriter,
    states: StateReader,
    fields: FieldReader,
    boot_id: u64,
    seq: u64,
}

impl Readings {
    fn new(bus: &Bus) -> Self {
        Self {
            sensor: SensorWriter::create(bus, &Topic::sensor("finger").unwrap()).unwrap(),
            states: states(bus),
            fields: FieldReader::open(bus, &Topic::field("finger", None).unwrap()).unwrap(),
            boot_id: 1,
            seq: 0,
        }
    }

    /// Sends one reading; its state, and y of all nodes.
    fn answer(&mut self, t_sensor_ns: u64, pressure_mpa: f64) -> (State, Vec<f32>) {
        self.seq += 1;
        let (boot_id, seq) = (self.boot_id, self.seq);
        let reading =
            SensorSample { boot_id, seq, t_sensor_ns, pressure_mpa, gap_mm: GAP_MM, ..Default::default() };
        self.sensor.publish(reading).unwrap();
        let of_it = |boot: u64, number: u64| (boot, number) == (boot_id, seq);
        let state =
            wait_state(&self.states, "its state", |state| of_it(state.sensor_boot_id, state.sensor_seq));
        let y = wait_for(&self.fields, "its field", |fields| {
            let sample = fields.next().unwrap()?;
            let header = sample.header();
            of_it(header.sensor_boot_id, header.sensor_seq)
                .then(|| sample.field(field_id::Y).unwrap().to_vec())
        });
        (state, y)
    }

    fn run(&mut self, begin_ns: u64, pressures_mpa: &[f64]) -> Vec<(State, Vec<f32>)> {
        let at = |(i, pressure_mpa): (u64, &f64)| self.answer(begin_ns + i * STEP_NS, *pressure_mpa);
        (0..).zip(pressures_mpa).map(at).collect()
    }
}

/// Bits of everything in a state that follows from the readings.
fn bits((state, y): &(State, Vec<f32>)) -> Vec<u64> {
    let numbers = [state.contact_force_n, state.onset_pressure_mpa].into_iter().chain(state.inputs);
    let numbers = numbers.map(f64::to_bits).chain(y.iter().map(|y| u64::from(y.to_bits())));
    let late = flags::LATE;
    numbers.chain([u64::from(state.regime), u64::from(state.flags & !late)]).collect()
}

/// Swings free after a step, lands, leaves, and comes to rest.
fn pressures_mpa() -> Vec<f64> {
    let ramp = |at: usize, from: usize| (at.saturating_sub(from) as f64 / 4.0).min(1.0);
    (0..360).map(|i| 0.02 + 0.04 * ramp(i, 2) + 0.12 * ramp(i, 60) - 0.16 * ramp(i, 110)).collect()
}

/// Position of the inertial load in the inputs.
const LOAD_AT: usize = 2;

fn column(path: &Path, name: &str) -> Vec<f64> {
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let at = lines.next().unwrap().split(',').position(|column| column == name).unwrap();
    lines.map(|line| line.split(',').nth(at).unwrap().parse().unwrap()).collect()
}

/// y of the tip and contact force at pressures, by `softtwin predict`.
fn predicted(stage: &Stage, pressures: &[f64]) -> [Vec<f64>; 2] {
    let rows = pressures.iter().enumerate().map(|(i, p)| format!("{},{p},{GAP_MM}\n", 5e-3 * i as f64));
    stage.write("trace.csv", &format!("t_s,pressure_mpa,gap_mm\n{}", rows.collect::<String>()));
    let line = "predict beam.twin --json --trace trace.csv --step-ms 5 --out series.csv";
    let mut predict = Program::tool(stage, &line.split(' ').collect::<Vec<_>>());
    let (status, said) = predict.end();
    assert!(status.success(), "{said:?}");
    let report: Value = serde_json::from_str(&said.join("\n")).unwrap();
    assert_eq!((report["moves"].as_bool(), report["restarts"].as_u64()), (Some(true), Some(0)), "{report}");
    ["tip_y_mm", "contact_force_n"].map(|name| column(&stage.path("series.csv"), name))
}

#[test]
fn live_twin_of_a_relaxing_elastomer_moves_as_predict() {
    let stage = stage_of("relaxing", &moving::relaxing_bytes());
    let pressures = &pressures_mpa()[..100];
    let [tip, force] = predicted(&stage, pressures);
    let _twin = twin(&stage);
    let bus = stage.bus();
    let found = Readings::new(&bus).run(now_ns() - 30_000_000_000, pressures);
    for (i, ((state, y), (tip_mm, force_n))) in found.iter().zip(tip.iter().zip(&force)).enumerate() {
        assert_eq!(state.contact_force_n, *force_n, "{i}");
        assert!((f64::from(y[2]) - tip_mm).abs() < 1e-5, "{i}: {} {tip_mm}", y[2]);
    }
    // 200 ms after the step the pressure that acts is still behind the measured one.
    let late = pressures[59] - found[59].0.pressure_mpa;
    assert!(late > 5e-5 && force.iter().any(|force| *force > 0.0), "{late}");
}

#[test]
fn live_twin_swings_as_predict_and_begins_at_rest_after_gaps_and_restarts() {
    let stage = stage("swing");
    let pressures = pressures_mpa();
    let [tip, force] = predicted(&stage, &pressures);
    let running = twin(&stage);
    let bus = stage.bus();
    let mut readings = Readings::new(&bus);
    // All stamps lie in the past, those of later runs after those of earlier ones.
    let begin_ns = now_ns() - 30_000_000_000;
    let found = readings.run(begin_ns, &pressures);
    assert_eq!(found.len(), tip.len());
    for (i, ((state, y), (tip_mm, force_n))) in found.iter().zip(tip.iter().zip(&force)).enumerate() {
        assert_eq!(state.outcome, Outcome::Published.code());
        assert_eq!(state.contact_force_n, *force_n, "{i}");
        assert!((f64::from(y[2]) - tip_mm).abs() < 1e-5, "{i}: {} {tip_mm}", y[2]);
        assert_eq!(state.flags & flags::OUTSIDE_DOMAIN, 0, "{i}: load {}", state.inputs[LOAD_AT]);
    }
    // It overshoots, touches and comes to rest where it began, at the equilibrium of the same pressure.
    let loads: Vec<f64> = found.iter().map(|(state, _)| state.inputs[LOAD_AT]).collect();
    let (low, high) =
        loads[..60].iter().fold((0.0_f64, 0.0_f64), |(l, h), a| (l.min(a - REST), h.max(a - REST)));
    assert!(high > 3000.0 && low < -500.0, "{low} .. {high}");
    assert!(found[60..110].iter().any(|(state, _)| state.regime == regime::CONTACT));
    let (last, last_y) = &found[found.len() - 1];
    assert_eq!(last.regime, regime::FREE);
    assert!((last.inputs[LOAD_AT] - REST).abs() < 1.0, "{}", last.inputs[LOAD_AT]);
    let worst_mm = last_y.iter().zip(&found[0].1).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst_mm < 1e-3, "{worst_mm} mm");
    assert_eq!(found[0].0.inputs[LOAD_AT].to_bits(), REST.to_bits());

    // A reading with the stamp of the last one has no answer and changes nothing.
    let end_ns = begin_ns + (pressures.len() as u64 - 1) * STEP_NS;
    readings.seq += 1;
    let twice = SensorSample {
        boot_id: 1,
        seq: readings.seq,
        t_sensor_ns: end_ns,
        pressure_mpa: 0.3,
        gap_mm: GAP_MM,
        ..Default::default()
    };
    readings.sensor.publish(twice).unwrap();
    // After more than 1 s the same readings have the same answers, bit by bit.
    let first: Vec<_> = found.iter().map(bits).collect();
    let again = readings.run(end_ns + 1_500_000_000, &pressures[..80]);
    assert!(again.iter().map(bits).eq(first[..80].iter().cloned()), "after a gap");
    // Another run of the bridge, whose clock is behind.
    (readings.boot_id, readings.seq) = (2, 0);
    let again = readings.run(begin_ns - 5_000_000_000, &pressures[..80]);
    assert!(again.iter().map(bits).eq(first[..80].iter().cloned()), "after a restart of the bridge");
    // Another run of the twin, in the middle of a swing.
    let before = again[0].0.boot_id;
    let (status, said) = running.stop();
    assert!(status.success(), "{said:?}");
    assert!(said.iter().any(|line| line.contains("1 dropped: back in time")), "{said:#?}");
    let mut running = twin(&stage);
    let again = readings.run(begin_ns + 5_000_000_000, &pressures);
    assert!(again.iter().map(bits).eq(first.iter().cloned()), "after a restart of the twin");
    assert_ne!(again[0].0.boot_id, before);
    // The half-widths contain a swing that the past may have left, until it has faded.
    let widths_mm = [0, again.len() - 1].map(|at| again[at].0.displacement_halfwidth_mm);
    assert!(widths_mm[0] > 1.0 && widths_mm[1] < 0.1 * widths_mm[0], "{widths_mm:?}");
    // Shorter gaps: the motion continues with the last pressure up to the next reading.
    let t_ns = again[again.len() - 1].0.t_sensor_ns;
    let (held, _) = readings.answer(t_ns + 500_000_000, 0.03);
    assert!((held.inputs[LOAD_AT] - REST).abs() > 100.0, "{}", held.inputs[LOAD_AT]);
    // A reload of the model in the middle of a swing.
    running.signal(libc::SIGHUP);
    running.wait_for("reloaded");
    let (rest, _) = readings.answer(t_ns + 505_000_000, 0.06);
    assert_eq!(rest.inputs[LOAD_AT].to_bits(), REST.to_bits());
    assert!(running.stop().0.success());
}

#[test]
fn inertial_load_outside_of_the_training_states_is_flagged_also_between_readings() {
    let stage = stage("outside");
    let _twin = twin(&stage);
    let bus = stage.bus();
    let mut readings = Readings::new(&bus);
    let begin_ns = now_ns() - 30_000_000_000;
    let (rest, _) = readings.answer(begin_ns, 0.0);
    assert_eq!(
        (rest.flags & flags::OUTSIDE_DOMAIN, rest.domain_status),
        (0, 0),
        "{LOAD}: {}",
        rest.inputs[LOAD_AT]
    );
    // The pressure of the full range within 5 ms needs more than the largest load of the training states.
    let (thrown, _) = readings.answer(begin_ns + STEP_NS, 0.3);
    assert!(thrown.flags & flags::OUTSIDE_DOMAIN != 0, "load {}", thrown.inputs[LOAD_AT]);
    assert!(thrown.domain_distance > 0.0 && thrown.domain_status == 2, "{}", thrown.domain_distance);
    // 200 ms later the load is inside again, but was outside in between.
    let (later, _) = readings.answer(begin_ns + 40 * STEP_NS, 0.3);
    assert!((-60_000.0..40_000.0).contains(&later.inputs[LOAD_AT]), "load {}", later.inputs[LOAD_AT]);
    assert!(later.flags & flags::OUTSIDE_DOMAIN != 0);
    let (inside, _) = readings.answer(begin_ns + 41 * STEP_NS, 0.3);
    assert_eq!(
        (inside.flags & flags::OUTSIDE_DOMAIN, inside.domain_status),
        (0, 0),
        "{}",
        inside.inputs[LOAD_AT]
    );
}
