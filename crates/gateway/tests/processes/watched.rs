//! Messages to the service manager, and counts.

use crate::common::{
    FAST_SINE, far_end, free_port, gateway, gateway_in, gateway_with_metrics, get, get_until, subscribe,
    wait_sample,
};
use serde_json::{Value, json};
use tests::http::{free_address, metric};
use tests::wait::wait_until;
use tests::{Manager, Program, Stage};
use wire::{FieldReader, Topic, now_ns};
use zenoh::Wait;

/// Ready when it listens, alive while all threads run, stopping when asked.
#[test]
fn the_service_manager_gets_ready_watchdog_and_stopping() {
    let stage = Stage::new("gwnotify");
    let manager = Manager::new(&stage);
    let config =
        format!("listen = [\"tcp/127.0.0.1:{}\"]\nreadings_from_network = [\"finger\"]", free_port());
    let gateway = gateway_in(&stage, &config, &manager.environment());
    let ready = manager.receive("READY=1");
    assert!(ready.last().unwrap().contains("STATUS=listens on tcp/127.0.0.1:"), "{ready:?}");
    assert!(
        !ready.iter().any(|message| message.contains("WATCHDOG=1")),
        "alive before it is ready: {ready:?}"
    );
    manager.receive("WATCHDOG=1");
    manager.receive("WATCHDOG=1");
    let (status, said) = gateway.stop();
    assert!(status.success(), "{said:?}");
    manager.receive("STOPPING=1");
}

/// Without its files in shared memory it would not find the topics of twins that start again: the service manager restarts it.
#[test]
fn removed_files_in_shared_memory_end_the_gateway() {
    let stage = Stage::new("gwremoved");
    let scene = stage.finger(FAST_SINE);
    let twin = Program::twin(&stage, &scene);
    let port = free_port();
    let mut gateway = gateway(&stage, &format!("listen = [\"tcp/127.0.0.1:{port}\"]"));
    let _bridge = Program::bridge(&stage, &scene);
    // Topics are open where they have a subscriber.
    let session = far_end(port);
    wait_sample(&subscribe(&session, "softtwin/finger/state"), "a state", |_| Some(()));
    for file in stage.everything().iter().filter(|file| file.to_string_lossy().ends_with(".dynamic")) {
        std::fs::remove_file(file).unwrap();
    }
    let (status, said) = gateway.end();
    assert_eq!(status.code(), Some(1), "{said:?}");
    assert!(said.iter().any(|line| line.contains(".dynamic")), "{said:?}");
    drop(twin);
}

/// Restarting the gateway would not bring the router back.
#[test]
fn a_client_without_its_router_is_ready_and_alive() {
    let stage = Stage::new("gwpatient");
    let manager = Manager::new(&stage);
    let config = format!("mode = \"client\"\nconnect = [\"tcp/127.0.0.1:{}\"]", free_port());
    let gateway = gateway_in(&stage, &config, &manager.environment());
    let started = manager.receive("READY=1");
    assert!(started.last().unwrap().contains("STATUS="), "{started:?}");
    manager.receive("WATCHDOG=1");
    manager.receive("WATCHDOG=1");
    assert!(gateway.stop().0.success());
}

#[test]
fn wrong_configuration_is_never_ready() {
    let stage = Stage::new("gwunready");
    let manager = Manager::new(&stage);
    let (status, said) = gateway_in(&stage, "listen = []", &manager.environment()).ended();
    assert_eq!(status.code(), Some(78), "{said:?}");
    while let Some(message) = manager.next(std::time::Duration::from_millis(1)) {
        assert!(!message.contains("READY"), "{message}");
    }
}

/// The count `name` in the line at the end of the log.
fn counted(said: &[String], name: &str) -> u64 {
    let line = said.iter().rfind(|line| line.contains("ended:")).expect("counts at the end");
    let value = line.split(' ').find_map(|word| word.strip_prefix(name)?.strip_prefix('=')?.parse().ok());
    value.unwrap_or_else(|| panic!("`{name}` is not in {line}"))
}

/// 10 of 500 fields per second are sent: sent ones are numbered, the others are counted.
#[test]
fn replaced_fields_are_counted() {
    let stage = Stage::new("gwcount");
    let scene = stage.finger(FAST_SINE);
    let _twin = Program::twin(&stage, &scene);
    let bridge = Program::bridge(&stage, &scene);
    let port = free_port();
    let gateway = gateway(&stage, &format!("listen = [\"tcp/127.0.0.1:{port}\"]\nfield_rate_hz = 10.0"));
    let local = FieldReader::open(&stage.bus(), &Topic::field("finger", None).unwrap()).unwrap();
    let session = far_end(port);
    let far = subscribe(&session, "softtwin/finger/field");
    let mut seen: Vec<(u64, u64)> = Vec::new();
    wait_sample(&far, "20 fields", |sample| {
        let about: Value = serde_json::from_slice(&sample.attachment()?.to_bytes()).ok()?;
        seen.push((about["gateway_seq"].as_u64()?, about["seq"].as_u64()?));
        (seen.len() == 20).then_some(())
    });
    let numbers: Vec<u64> = seen.iter().map(|(number, _)| *number).collect();
    assert_eq!(numbers, (1..=20).collect::<Vec<u64>>(), "numbers of what was sent to the only subscriber");
    assert!(bridge.stop().0.success());
    let (status, said) = gateway.stop();
    assert!(status.success(), "{said:?}");
    let newest = local.newest().unwrap().expect("a field").header().seq;
    let (sent, replaced) = (counted(&said, "fields"), counted(&said, "fields_replaced"));
    let between = seen[19].1 - seen[0].1 - 19;
    assert!(sent >= 20 && replaced >= between, "{sent} sent, {replaced} replaced, at least {between} were");
    assert!(
        sent + replaced <= newest - seen[0].1 + 1,
        "{sent} sent, {replaced} replaced: more than there were"
    );
    assert!(between > 0, "no field was replaced between 20 sent ones");
}

/// Metrics equal the counts of the network client.
#[test]
fn metrics_count_sent_and_received_messages() {
    let stage = Stage::new("gwmetrics");
    let scene = stage.finger(FAST_SINE);
    let twin = Program::twin(&stage, &scene);
    let (port, page) = (free_port(), free_address());
    let config = format!(
        "listen = [\"tcp/127.0.0.1:{port}\"]\nfield_rate_hz = 10.0\nreadings_from_network = [\"other\"]"
    );
    let gateway = gateway_with_metrics(&stage, &config, &page);
    let value = |name: &str| {
        metric(&page, &format!("softtwin_gateway_{name}")).unwrap_or_else(|| panic!("{name} is missing"))
    };
    let reaches = |name: &str, wanted: u64| {
        wait_until(&format!("{name} {wanted}"), || (value(name) == wanted as f64).then_some(()));
    };
    for name in [
        "messages",
        "fields",
        "fields_replaced",
        "late_periods",
        "answers",
        "refusals",
        "readings",
        "bad_readings",
    ] {
        assert_eq!(value(&format!("{name}_total")), 0.0, "{name}");
    }
    assert_eq!(value("lost"), 0.0);
    let session = far_end(port);
    // States of a bridge that ends: a number that stays.
    let states = subscribe(&session, "softtwin/finger/state");
    let fields = subscribe(&session, "softtwin/finger/field");
    let bridge = Program::bridge(&stage, &scene);
    let (mut seen, mut drawn) = (0_u64, 0_u64);
    wait_sample(&fields, "5 fields", |_| {
        drawn += 1;
        (drawn == 5).then_some(())
    });
    wait_sample(&states, "200 states", |_| {
        seen += 1;
        (seen == 200).then_some(())
    });
    assert!(bridge.stop().0.success() && twin.stop().0.success());
    wait_until("all states that were counted", || {
        seen += states.try_iter().count() as u64;
        drawn += fields.try_iter().count() as u64;
        (value("messages_total") == seen as f64).then_some(())
    });
    assert!(value("fields_total") >= drawn as f64 && value("fields_replaced_total") > 10.0);
    assert_eq!(value("lost"), 0.0);
    assert!(value("longest_send_seconds") > 0.0);
    // Queries: an answered one and a malformed one.
    let _twin = Program::twin(&stage, &scene);
    get_until(&session, "softtwin/finger/whatif?pressure_mpa=0.03;gap_mm=30", Result::ok);
    let (answers, refusals) = (value("answers_total") as u64, value("refusals_total") as u64);
    assert!(answers > 0);
    get(&session, "softtwin/finger/whatif?pressure_mpa=0.04;gap_mm=30").unwrap().unwrap();
    reaches("answers_total", answers + 1);
    get(&session, "softtwin/finger/whatif?pressure_mpa=oops").unwrap().unwrap_err();
    reaches("refusals_total", refusals + 1);
    // Readings: sent until the first one arrives, then counted.
    let key = "softtwin/other/sensor";
    let reading = |seq: u64| json!({ "boot_id": "aa", "seq": seq, "t_sensor_ns": now_ns(), "pressure_mpa": 0.03, "gap_mm": 30.0 });
    let put = |message: Value| session.put(key, message.to_string()).wait().expect("sent");
    wait_until("a reading", || {
        put(reading(now_ns()));
        (value("readings_total") > 0.0).then_some(())
    });
    // Messages of a key arrive in order: when this one is counted, none of the readings before it is still on its way.
    put(json!("no reading"));
    reaches("bad_readings_total", 1);
    let readings = value("readings_total") as u64;
    put(reading(u64::MAX));
    reaches("readings_total", readings + 1);
    let (status, said) = gateway.stop();
    assert!(status.success(), "{said:?}");
    assert_eq!(counted(&said, "readings"), readings + 1);
}
