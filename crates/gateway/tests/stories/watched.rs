//! What the gateway tells of itself: to the service manager, and in its account.

use crate::common::{FAST_SINE, far_end, free_port, gateway, gateway_in, subscribe, wait_sample};
use serde_json::Value;
use tests::{Manager, Program, Stage};
use wire::{FieldReader, Topic};

/// Ready when it listens, alive while its threads turn, stopping when asked.
#[test]
fn it_tells_the_service_manager_how_it_is() {
    let stage = Stage::new("gwnotify");
    let manager = Manager::new(&stage);
    let config =
        format!("listen = [\"tcp/127.0.0.1:{}\"]\nreadings_from_network = [\"finger\"]", free_port());
    let gateway = gateway_in(&stage, &config, &manager.environment());
    let ready = manager.told("READY=1");
    assert!(ready.last().unwrap().contains("STATUS=listens on tcp/127.0.0.1:"), "{ready:?}");
    assert!(
        !ready.iter().any(|message| message.contains("WATCHDOG=1")),
        "alive before it is ready: {ready:?}"
    );
    manager.told("WATCHDOG=1");
    manager.told("WATCHDOG=1");
    let (status, said) = gateway.stop();
    assert!(status.success(), "{said:?}");
    manager.told("STOPPING=1");
}

/// A router that is away is not cured by starting the gateway again.
#[test]
fn a_client_that_waits_for_its_router_has_started_and_is_alive() {
    let stage = Stage::new("gwpatient");
    let manager = Manager::new(&stage);
    let config = format!("mode = \"client\"\nconnect = [\"tcp/127.0.0.1:{}\"]", free_port());
    let gateway = gateway_in(&stage, &config, &manager.environment());
    let started = manager.told("READY=1");
    assert!(started.last().unwrap().contains("STATUS=nobody answers"), "{started:?}");
    manager.told("WATCHDOG=1");
    manager.told("WATCHDOG=1");
    assert!(gateway.stop().0.success());
}

#[test]
fn a_wrong_configuration_never_says_ready() {
    let stage = Stage::new("gwunready");
    let manager = Manager::new(&stage);
    let (status, said) = gateway_in(&stage, "listen = []", &manager.environment()).ended();
    assert_eq!(status.code(), Some(78), "{said:?}");
    while let Some(message) = manager.next(std::time::Duration::from_millis(1)) {
        assert!(!message.contains("READY"), "{message}");
    }
}

/// The number in front of `text` in the last account.
fn counted(said: &[String], text: &str) -> u64 {
    let line = said.iter().rfind(|line| line.contains("ended:")).expect("an account at the end");
    let (before, _) = line.split_once(text).unwrap_or_else(|| panic!("`{text}` is not in {line}"));
    before.rsplit([' ', '(']).next().and_then(|number| number.parse().ok()).expect("a number")
}

/// Of 500 fields a second 10 go out: each has its number, and those in between are in the account.
#[test]
fn fields_whose_place_a_newer_one_took_are_counted() {
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
    let (sent, replaced) = (counted(&said, " fields sent"), counted(&said, " fields replaced"));
    let between = seen[19].1 - seen[0].1 - 19;
    assert!(sent >= 20 && replaced >= between, "{sent} sent, {replaced} replaced, at least {between} were");
    assert!(
        sent + replaced <= newest - seen[0].1 + 1,
        "{sent} sent, {replaced} replaced: more than there were"
    );
    assert!(between > 100, "a twin at 500 Hz has more than {between} fields in two seconds");
}
