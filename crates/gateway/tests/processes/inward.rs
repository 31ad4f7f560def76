//! Readings from the network: only where the configuration allows it, judged by the twin as any other reading.

use crate::common::{FAST_SINE, far_end, free_port, gateway};
use serde_json::{Value, json};
use std::time::{Duration, Instant};
use tests::wait::{fresh, states, wait_for, wait_state, wait_until};
use tests::{Program, Stage};
use wire::layout::unpack_name;
use wire::{HealthReader, KeyExpr, Outcome, TargetReader, TargetWriter, Topic, Valve, ValveWriter, now_ns};
use zenoh::{Session, Wait};

fn put(session: &Session, key: &str, message: &Value) {
    session.put(key, message.to_string()).wait().expect("sent");
}

/// A reading of a machine whose clock is an hour ahead of ours.
fn reading(seq: u64, pressure_mpa: Value) -> Value {
    json!({
        "boot_id": "00000000000000aa",
        "seq": seq,
        "t_sensor_ns": now_ns() + 3_600_000_000_000,
        "pressure_mpa": pressure_mpa,
        "gap_mm": 30.0,
    })
}

#[test]
fn readings_come_in_where_they_may_and_are_judged_by_the_twin() {
    let stage = Stage::new("gwin");
    let scene = stage.finger(FAST_SINE);
    let _twin = Program::twin(&stage, &scene);
    let port = free_port();
    let config = format!("listen = [\"tcp/127.0.0.1:{port}\"]\nreadings_from_network = [\"finger\"]");
    let gateway = gateway(&stage, &config);
    let session = far_end(port);
    let bus = stage.bus();
    let (state, health) =
        (states(&bus), HealthReader::open(&bus, &Topic::health("finger").unwrap()).unwrap());
    let key = "softtwin/finger/sensor";
    // Sent until it arrives: the subscription may be on its way still.
    let end = Instant::now() + tests::PATIENCE;
    let mut seq = 0;
    let first = loop {
        seq += 1;
        put(&session, key, &reading(seq, json!(0.04)));
        std::thread::sleep(Duration::from_millis(20));
        if let Some(found) = state.newest().unwrap().filter(fresh) {
            break found;
        }
        assert!(Instant::now() < end, "no reading came through");
    };
    assert!((first.pressure_mpa - 0.04).abs() < 1e-12 && first.sensor_boot_id == 0xaa);
    assert!(
        first.age_ns < 1_000_000_000,
        "the hour between the clocks is not taken for age: {}",
        first.age_ns
    );
    let held = |message: Value, expected: Outcome| {
        put(&session, key, &message);
        wait_state(&state, expected.as_str(), |state| state.outcome == expected.code());
    };
    held(reading(seq + 1, json!("NaN")), Outcome::HeldNotFinite);
    held(reading(seq + 2, json!(7.5)), Outcome::HeldAbsurd);
    let old = reading(seq + 3, json!(0.04));
    std::thread::sleep(Duration::from_millis(1200)); // the network's delay
    held(old, Outcome::HeldStale);
    let mut turned = reading(seq + 4, json!(0.04));
    turned["t_sensor_ns"] = json!(turned["t_sensor_ns"].as_u64().unwrap() - 5_000_000_000);
    put(&session, key, &turned);
    let counted = wait_for(&health, "the reading that went back in time", |health| {
        health.newest().unwrap().filter(|health| health.count(Outcome::DroppedBackInTime) == 1)
    });
    assert_eq!(counted.outcomes.iter().sum::<u64>(), counted.received, "a reading has no end");
    put(&session, key, &json!({ "pressure_mpa": 0.04 }));
    put(&session, key, &json!("not a reading"));
    put(&session, key, &reading(seq + 5, json!(0.041)));
    wait_state(&state, "the next good reading", |state| fresh(state) && state.sensor_seq == seq + 5);
    let (status, said) = gateway.stop();
    assert!(status.success());
    assert!(said.iter().any(|line| line.contains(key)), "{said:#?}");
    assert!(said.last().unwrap().contains(" bad_readings=2 "), "{said:#?}");
}

#[test]
fn readings_go_nowhere_where_they_may_not() {
    let stage = Stage::new("gwshut");
    let scene = stage.finger(FAST_SINE);
    let _twin = Program::twin(&stage, &scene);
    let port = free_port();
    let _gateway = gateway(&stage, &format!("listen = [\"tcp/127.0.0.1:{port}\"]"));
    let session = far_end(port);
    let publisher = session.declare_publisher("softtwin/finger/sensor").wait().unwrap();
    // The state is subscribed to by the same gateway's session, so what it would take in is declared by now.
    crate::common::wait_sample(
        &crate::common::subscribe(&session, "softtwin/finger/state"),
        "a state",
        |_| Some(()),
    );
    assert!(!publisher.matching_status().wait().unwrap().matching(), "the gateway listens for readings");
    let found = stage.bus().topics(&KeyExpr::new("softtwin/*/sensor").unwrap()).unwrap();
    assert!(found.iter().all(|info| info.writers.is_empty()), "{found:?}");
}

#[test]
fn a_bridge_that_is_there_already_keeps_its_place() {
    let stage = Stage::new("gwheld");
    let scene = stage.finger(FAST_SINE);
    let _twin = Program::twin(&stage, &scene);
    let bridge = Program::bridge(&stage, &scene);
    let port = free_port();
    let config = format!("listen = [\"tcp/127.0.0.1:{port}\"]\nreadings_from_network = [\"finger\"]");
    let mut gateway = crate::common::gateway_unready(&stage, &config);
    let line = gateway.wait_for("another process already publishes here");
    assert!(line.contains(&format!("process {}", bridge.id())), "{line}");
    drop(bridge);
    let session = far_end(port);
    let state = states(&stage.bus());
    wait_until("the network takes over", || {
        put(&session, "softtwin/finger/sensor", &reading(now_ns() / 1000, json!(0.02)));
        state.newest().unwrap().filter(|state| state.sensor_boot_id == 0xaa)
    });
}

const COMMANDS: &str = "0/softtwin/finger/commands/std_msgs::msg::dds_::Float64MultiArray_/RIHS01_1025ddc6b9552d191f89ef1a8d2f60f3d373e28b283d8891ddcc974e8c55397f";
const STATE: &str = "0/softtwin/finger/state/sensor_msgs::msg::dds_::JointState_/RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e";

/// A `std_msgs/Float64MultiArray` in CDR, as `rosbags` writes it.
fn float_array(values: &[f64]) -> Vec<u8> {
    let mut bytes = vec![0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
    bytes.extend((values.len() as u32).to_le_bytes());
    bytes.extend([0; 4]);
    bytes.truncate(if values.is_empty() { 16 } else { 20 });
    bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    bytes
}

/// Targets come from ROS where they may, by one owner; what the valve was given goes back.
#[test]
fn targets_come_from_ros_and_the_valve_goes_back() {
    let stage = Stage::new("gwtarget");
    let bus = stage.bus();
    let mut valve = ValveWriter::create(&bus, &Topic::valve("finger").unwrap()).unwrap();
    let port = free_port();
    let config = format!(
        "listen = [\"tcp/127.0.0.1:{port}\"]\ntargets_from_network = [\"finger\"]\n[ros2]\nnode = \"twins\"\n"
    );
    let mut gateway = gateway(&stage, &config);
    let session = far_end(port);
    let targets = TargetReader::attach(&bus, &Topic::target("finger").unwrap()).unwrap();
    let send = |values: &[f64]| session.put(COMMANDS, float_array(values)).wait().expect("sent");
    // Sent until it arrives: the subscription may be on its way still.
    let found = wait_until("the target", || {
        send(&[0.25]);
        targets.newest().unwrap()
    });
    assert_eq!((found.target_kind, found.value_count, found.values[0]), (0, 1, 0.25));
    assert_eq!(unpack_name(&found.owner), "twins");
    assert!(TargetWriter::create_named(&bus, &Topic::target("finger").unwrap(), "second").is_err());
    for wrong in [vec![], vec![f64::NAN], vec![0.1, 0.2]] {
        send(&wrong);
        gateway.wait_for(&format!("one finite value, found {wrong:?}"));
    }
    send(&[0.5]);
    wait_until("the next target", || targets.newest().unwrap().filter(|target| target.values[0] == 0.5));

    let states = crate::common::subscribe(&session, STATE);
    let message = wait_until("the valve's state", || {
        let sample =
            Valve { boot_id: 1, seq: 1, t_publish_ns: now_ns(), pressure_mpa: 0.02, ..Valve::default() };
        valve.publish(Valve { wanted_mpa: 0.03, ..sample }).unwrap();
        states.try_recv().ok()
    });
    let bytes = message.payload().to_bytes().into_owned();
    let positions: Vec<f64> = bytes[bytes.len() - 24..bytes.len() - 8]
        .chunks(8)
        .map(|eight| f64::from_le_bytes(eight.try_into().unwrap()))
        .collect();
    assert!(
        (positions[0] - 20_000.0).abs() < 1e-6 && (positions[1] - 30_000.0).abs() < 1e-6,
        "{positions:?}"
    );
    // Two seconds of silence give the right back.
    wait_until("the right to send targets", || {
        TargetWriter::create_named(&bus, &Topic::target("finger").unwrap(), "second").ok()
    });
}
