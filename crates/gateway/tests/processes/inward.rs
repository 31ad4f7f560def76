//! Readings from the network: only where the configuration allows it, judged by the twin as any other reading.

use crate::common::{FAST_SINE, far_end, free_port, gateway};
use serde_json::{Value, json};
use std::time::{Duration, Instant};
use tests::wait::{fresh, states, wait_for, wait_state, wait_until};
use tests::{Program, Stage};
use wire::{HealthReader, KeyExpr, Outcome, Topic, now_ns};
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
    assert!(said.iter().any(|line| line.contains("expected a reading")), "{said:#?}");
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
