//! Bridge and twin as real processes: the stream end to end, restarts, refusals, bad readings, clean ends.

use tests::wait::{fresh, states, wait_for, wait_state};
use tests::{Program, Stage, synthetic};
use wire::layout::{field_id, flags, regime};
use wire::{
    FieldReader, FieldSample, HealthReader, KeyExpr, Outcome, SensorSample, SensorWriter, Topic, now_ns,
};

const FAST_SINE: &str = r#"kind = "simulate"
rate_hz = 500.0
gap_mm = 30.0
profile = { shape = "sine", mean_mpa = 0.035, amplitude_mpa = 0.03, frequency_hz = 2.0 }"#;

/// Takes fields until that of reading `last` or a later one.
fn wait_fields(reader: &FieldReader, last: u64, mut each: impl FnMut(&FieldSample)) {
    wait_for(reader, "the last field", |reader| {
        let mut done = None;
        while let Some(sample) = reader.next().unwrap() {
            each(&sample);
            done = (sample.header().sensor_seq >= last).then_some(()).or(done);
        }
        done
    });
}

#[test]
fn replayed_trace_becomes_fields_without_loss() {
    let stage = Stage::new("stream");
    stage.trace("trace.csv", 200, 100.0, 0.06, 30.0);
    let scene = stage.finger("kind = \"replay\"\ntrace = \"trace.csv\"");
    let twin = Program::twin(&stage, &scene);
    let bus = stage.bus();
    let all = FieldReader::open(&bus, &Topic::field("finger", None).unwrap()).unwrap();
    let tip = FieldReader::open(&bus, &Topic::field("finger", Some("tip")).unwrap()).unwrap();
    let state = states(&bus);
    let mut bridge = Program::bridge(&stage, &scene);
    let (mut seqs, mut readings, mut regimes, mut worst_mm) = (Vec::new(), Vec::new(), Vec::new(), 0f64);
    wait_fields(&all, 200, |sample| {
        let header = sample.header();
        seqs.push(header.seq);
        readings.push(header.sensor_seq);
        regimes.push(header.regime);
        assert_eq!(sample.values().len(), 5 * synthetic::NODES);
        let truth = synthetic::snapshot(header.pressure_mpa, Some(30.0));
        let y = sample.field(field_id::Y).unwrap();
        for (found, node) in y.iter().zip(truth.chunks(5)) {
            worst_mm = worst_mm.max((f64::from(*found) - f64::from(node[1])).abs());
        }
        assert!(header.t_publish_ns >= header.t_sensor_ns);
    });
    // On a loaded machine the twin may sleep over a reading and take the newest: such a one has no field, but it is
    // counted below. What was sent has arrived, all of it, in order.
    let sent = seqs.len() as u64;
    assert_eq!(seqs, (1..=sent).collect::<Vec<u64>>(), "a field was lost or came twice");
    assert!(readings.is_sorted_by(|a, b| a < b) && sent > 100, "{sent} fields for 200 readings");
    assert!(worst_mm < 0.5, "the deformed beam is {worst_mm} mm off");
    let onset = regimes.iter().position(|number| *number == regime::CONTACT).expect("contact is reached");
    assert!(regimes[..onset].iter().all(|number| *number == regime::FREE));
    assert!(regimes[onset..].iter().all(|number| *number == regime::CONTACT), "the regime chatters");
    // Between the last free and the first touching reading that were answered: a loaded machine sleeps over some.
    let pressure_mpa = |at: usize| 0.06 * (readings[at] - 1) as f64 / 199.0;
    let (before, after, truth) = (pressure_mpa(onset - 1), pressure_mpa(onset), synthetic::onset_mpa(30.0));
    assert!(before < truth + 0.003 && after > truth - 0.003, "onset between {before} and {after} MPa");
    // The tip's samples were not read meanwhile: the newest are waiting.
    wait_fields(&tip, 200, |sample| {
        assert_eq!((sample.header().node_count, sample.header().field_count), (10, 2));
        assert!(sample.field(field_id::DISPLACEMENT).is_some() && sample.field(field_id::X).is_none());
    });
    let last = wait_state(&state, "the last state", |state| state.sensor_seq == 200);
    let truth_n = synthetic::force_n(0.06, 30.0);
    assert!(
        (last.contact_force_n - truth_n).abs() < 0.05 * truth_n,
        "{} N for {truth_n} N",
        last.contact_force_n
    );
    assert!(last.force_by_pressure_n_per_mpa > 0.0 && last.coefficient_count == 0);
    let (status, said) = bridge.end();
    assert!(status.success(), "{said:#?}");
    assert!(said.iter().any(|line| line.contains("200 readings sent")), "{said:#?}");
    let (status, said) = twin.stop();
    assert!(status.success(), "{said:#?}");
    let skipped = if sent < 200 { format!(", {} dropped: superseded", 200 - sent) } else { String::new() };
    let summary = format!("200 readings ({sent} published{skipped}), 0 never arrived");
    assert!(said.iter().any(|line| line.contains(&summary)), "`{summary}` is not in {said:#?}");
    drop((all, tip, state, bus));
    assert_eq!(stage.leftovers(), Vec::<String>::new(), "files are left behind");
}

#[test]
fn killed_bridge_makes_states_stale_until_its_restart() {
    let stage = Stage::new("bridge");
    let scene = stage.finger(FAST_SINE);
    let _twin = Program::twin(&stage, &scene);
    let bus = stage.bus();
    let reader = states(&bus);
    let bridge = Program::bridge(&stage, &scene);
    let before = wait_state(&reader, "a fresh state", fresh);
    bridge.kill();
    let stale = wait_state(&reader, "a stale state", |state| state.flags & flags::STALE != 0);
    assert!(stale.age_ns >= 90_000_000, "stale after {} ns, before its deadline of 100 ms", stale.age_ns);
    assert!(stale.contact_force_n.is_finite(), "the last good values stand");
    let _bridge = Program::bridge(&stage, &scene);
    let after = wait_state(&reader, "a fresh state again", |state| {
        fresh(state) && state.sensor_boot_id != before.sensor_boot_id
    });
    assert!(after.sensor_seq >= 1);
}

#[test]
fn restarted_twin_serves_its_old_readers() {
    let stage = Stage::new("twin");
    let scene = stage.finger(FAST_SINE);
    let twin = Program::twin(&stage, &scene);
    let bus = stage.bus();
    let reader = FieldReader::open(&bus, &Topic::field("finger", None).unwrap()).unwrap();
    let _bridge = Program::bridge(&stage, &scene);
    let check = |sample: &FieldSample| {
        let truth = synthetic::snapshot(sample.header().pressure_mpa, Some(30.0));
        let y = sample.field(field_id::Y).unwrap();
        let worst =
            y.iter().zip(truth.chunks(5)).map(|(found, node)| (found - node[1]).abs()).fold(0.0, f32::max);
        assert!(worst < 0.5, "a wrong field: {worst} mm off");
    };
    let mut first_run = 0;
    wait_fields(&reader, 50, |sample| {
        check(sample);
        first_run = sample.header().boot_id;
    });
    twin.kill();
    let _twin = Program::twin(&stage, &scene);
    wait_for(&reader, "fields of the second twin", |reader| {
        while let Some(sample) = reader.next().unwrap() {
            check(&sample);
            if sample.header().boot_id != first_run {
                return Some(());
            }
        }
        None
    });
}

#[test]
fn second_twin_and_bridge_are_refused_with_the_holders_process() {
    let stage = Stage::new("second");
    let scene = stage.finger(FAST_SINE);
    let path = scene.display().to_string();
    let twin = Program::twin(&stage, &scene);
    let (status, said) = Program::daemon(&stage, &["twin", "--scene", &path]).end();
    assert_eq!(status.code(), Some(1), "{said:#?}");
    let text = said.join("\n");
    assert!(text.contains(&format!("process {}", twin.id())), "{text}");
    let bridge = Program::bridge(&stage, &scene);
    let (status, said) = Program::daemon(&stage, &["bridge", "--scene", &path]).end();
    assert_eq!(status.code(), Some(1), "{said:#?}");
    assert!(said.join("\n").contains(&format!("process {}", bridge.id())), "{said:#?}");
}

#[test]
fn bad_readings_have_outcomes_and_are_counted() {
    let stage = Stage::new("bad");
    let scene = stage.finger(FAST_SINE);
    let twin = Program::twin(&stage, &scene);
    let bus = stage.bus();
    let state = states(&bus);
    let health = HealthReader::open(&bus, &Topic::health("finger").unwrap()).unwrap();
    let mut sensor = SensorWriter::create(&bus, &Topic::sensor("finger").unwrap()).unwrap();
    let good = |seq| SensorSample {
        boot_id: 3,
        seq,
        t_sensor_ns: now_ns(),
        pressure_mpa: 0.04,
        gap_mm: 30.0,
        ..SensorSample::default()
    };
    let first_sample = good(1); // stamped before the others
    let bad: [(SensorSample, Outcome); 7] = [
        (SensorSample { pressure_mpa: f64::NAN, ..good(2) }, Outcome::HeldNotFinite),
        (SensorSample { pressure_mpa: -0.5, ..good(3) }, Outcome::HeldAbsurd),
        (SensorSample { gap_mm: f64::NEG_INFINITY, ..good(4) }, Outcome::HeldNotFinite),
        (SensorSample { status: 9, ..good(5) }, Outcome::HeldSensorFault),
        (SensorSample { t_sensor_ns: now_ns() + 60_000_000_000, ..good(6) }, Outcome::HeldFuture),
        (good(6), Outcome::DroppedDuplicate),
        (good(2), Outcome::DroppedBackInTime),
    ];
    sensor.publish(first_sample).unwrap();
    let first = wait_state(&state, "the good state", fresh);
    for (sample, expected) in &bad {
        sensor.publish(*sample).unwrap();
        if expected.is_held() {
            let held = wait_state(&state, expected.as_str(), |state| state.outcome == expected.code());
            assert!(held.flags & flags::HELD != 0);
            assert_eq!(
                held.contact_force_n.to_bits(),
                first.contact_force_n.to_bits(),
                "the last good value stands"
            );
            assert_eq!(held.sensor_seq, 1, "a held state names the reading its values are of");
        }
    }
    sensor.publish(good(10)).unwrap();
    wait_state(&state, "a good state again", |state| fresh(state) && state.sensor_seq == 10);
    let counted = wait_for(&health, "health", |health| health.newest().unwrap().filter(|h| h.received == 9));
    assert_eq!(counted.outcomes.iter().sum::<u64>(), counted.received, "a reading has no end");
    assert_eq!(counted.missed, 3, "readings 7 to 9 never arrived");
    assert_eq!(counted.count(Outcome::Published), 2);
    for outcome in bad.iter().map(|(_, outcome)| *outcome) {
        let expected = bad.iter().filter(|(_, other)| *other == outcome).count() as u64;
        assert_eq!(counted.count(outcome), expected, "{outcome}");
    }
    let (status, said) = twin.stop();
    assert!(status.success(), "{said:#?}");
}

#[test]
fn broken_files_are_refused_before_any_topic_is_created() {
    let stage = Stage::new("refuse");
    let expect = |name: &str, text: &str, arguments: &[&str], wanted: &[&str]| {
        let path = stage.write(name, text).display().to_string();
        let arguments: Vec<&str> =
            arguments.iter().map(|word| if *word == "FILE" { &path } else { *word }).collect();
        let (status, said) = Program::daemon(&stage, &arguments).end();
        let said = said.join("\n");
        assert_eq!(status.code(), Some(78), "{said}");
        for word in wanted {
            assert!(said.contains(word), "`{word}` is not in:\n{said}");
        }
    };
    let scene = stage.finger(FAST_SINE).display().to_string();
    let with_trace = ["bridge", "--scene", &scene, "--trace", "FILE"];
    expect("a.csv", "t_s,gap_mm\n0,1\n", &with_trace, &["column `pressure_mpa`", "header"]);
    expect(
        "b.csv",
        "t_s,pressure_mpa\n0,0.1\n1,oops\n2,\n",
        &with_trace,
        &["line 3", "`oops`", "line 4", "2 problems"],
    );
    expect("c.csv", "t_s,pressure_mpa\n1,0.1\n0,0.1\n", &with_trace, &["line 3", "column t_s"]);
    expect(
        "d.toml",
        "name = \"d\"\n[[actuator]]\nname = \"a/b\"\nmodel = \"beam.twin\"\ngap_mm = -1.0\n[[actuator]]\nname = \"x\"\nmodel = \"\"\n",
        &["twin", "--scene", "FILE"],
        &["3 problems", "`a/b` cannot name actuator", "gap_mm", "expected a model file"],
    );
    expect("e.toml", "nmae = \"d\"\n", &["twin", "--scene", "FILE"], &["unknown field `nmae`", "line 1"]);
    let scene = |extra: &str| format!("name = \"f\"\n[[actuator]]\nname = \"f\"\n{extra}");
    expect("f.toml", &scene("model = \"no.twin\""), &["twin", "--scene", "FILE"], &["model:", "no.twin"]);
    let outputs =
        "model = \"beam.twin\"\n[[actuator.output]]\nnodes = \"toe\"\n[[actuator.output]]\nfields = [\"q\"]";
    expect(
        "g.toml",
        &scene(outputs),
        &["twin", "--scene", "FILE"],
        &["\"toe\"", "tip", "\"q\"", "von_mises"],
    );
    stage.write("cut.twin", "SOFTTWIN");
    expect("h.toml", &scene("model = \"cut.twin\""), &["twin", "--scene", "FILE"], &["model:", "cut.twin"]);
    assert!(stage.bus().topics(&KeyExpr::new("**").unwrap()).unwrap().is_empty(), "something was bound");
}

#[test]
fn a_gap_in_time_is_announced_and_makes_the_state_stale() {
    let stage = Stage::new("gap");
    let rows: String = (0..20).map(|row| format!("{},0.03,30\n", f64::from(row) * 0.005)).collect();
    stage.write("gap.csv", &format!("t_s,pressure_mpa,gap_mm\n{rows}0.6,0.031,30\n"));
    let scene = stage.finger("kind = \"replay\"\ntrace = \"gap.csv\"");
    let _twin = Program::twin(&stage, &scene);
    let bus = stage.bus();
    let state = states(&bus);
    let mut bridge = Program::daemon(&stage, &["bridge", "--scene", &scene.display().to_string()]);
    bridge.wait_for("gap of 0.505 s before line 22");
    wait_state(&state, "a fresh state", fresh);
    wait_state(&state, "a stale state", |state| state.flags & flags::STALE != 0);
    wait_state(&state, "the reading after the gap", |state| fresh(state) && state.sensor_seq == 21);
}
