//! Regimes of a model's own: their names in states, fields and answers on the network, and in services of ROS 2; after a reload those
//! of the other model.

use crate::common::{far_end, free_port, gateway, get, get_until, json_of, subscribe, wait_sample};
use serde_json::Value;
use std::time::Duration;
use tests::strip::{self, Loads};
use tests::wait::wait_until;
use tests::{Program, Stage};
use zenoh::sample::Sample;
use zenoh::{Session, Wait};

/// Of Linux.
const SIGHUP: i32 = 1;

#[test]
fn names_of_regimes_reach_the_network_and_change_with_the_model() {
    let stage = Stage::with_model("gwnames", &[]);
    let scene = strip::scene(&stage, &strip::model_bytes(["straight", "up", "down"]));
    let mut twin = Program::twin(&stage, &scene);
    let port = free_port();
    let _gateway = gateway(&stage, &format!("listen = [\"tcp/127.0.0.1:{port}\"]\n[ros2]\n"));
    let session = far_end(port);
    let mut loads = Loads::new(&stage.bus());
    said_everywhere(&session, &mut loads, ["up", "straight"]);
    std::fs::write(stage.path("strip.twin"), strip::model_bytes(["rest", "high", "low"])).unwrap();
    twin.signal(SIGHUP);
    twin.wait_for("reloaded");
    said_everywhere(&session, &mut loads, ["high", "rest"]);
    assert!(twin.stop().0.success());
}

/// The bent regime of the state, the straight one of a load below the critical one.
fn said_everywhere(session: &Session, loads: &mut Loads, [bent, straight]: [&str; 2]) {
    let states = subscribe(session, "softtwin/strip/state");
    loads.send(13.0);
    wait_sample(&states, bent, |sample| (json_of(sample)["regime"] == bent).then_some(()));
    let beside = |sample: &Sample| -> Value {
        serde_json::from_slice(&sample.attachment().expect("what stands beside it").to_bytes()).expect("JSON")
    };
    // A field is read from the request on; it comes with the next reading.
    wait_until("a field", || {
        loads.send(13.0);
        let field = get(session, "softtwin/strip/field")?.ok()?;
        (beside(&field)["regime"] == bent).then_some(())
    });
    get_until(session, "softtwin/strip/whatif?load_n=5", |reply| {
        (json_of(&reply.ok()?)["regime"] == straight).then_some(())
    });
    let described = asked_by_ros(session, "describe", &[0, 1, 0, 0, 0]);
    let described = String::from_utf8_lossy(&described);
    assert!(described.contains(&format!("\"regime\":\"{bent}\"")), "{described}");
    let answer = asked_by_ros(session, "what_if", &what_if(5.0));
    let text = [&(straight.len() as u32 + 1).to_le_bytes()[..], straight.as_bytes(), &[0]].concat();
    assert!(answer.windows(text.len()).any(|part| part == text), "{}", String::from_utf8_lossy(&answer));
}

/// The response of a service of the strip, asked as `rmw_zenoh` asks: its token has the type and the hash for the key.
fn asked_by_ros(session: &Session, service: &str, request: &[u8]) -> Vec<u8> {
    let token = wait_until(service, || {
        let tokens = session.liveliness().get("@ros2_lv/**").timeout(Duration::from_secs(5)).wait().ok()?;
        let keys = tokens.iter().filter_map(|reply| Some(reply.into_result().ok()?.key_expr().to_string()));
        let name = format!("/%softtwin%strip%{service}/");
        keys.into_iter().find(|key| key.contains(&name))
    });
    let parts: Vec<&str> = token.split('/').collect();
    let key = format!("0/softtwin/strip/{service}/{}/{}", parts[10], parts[11]);
    let beside = [&1_i64.to_le_bytes()[..], &0_i64.to_le_bytes(), &[16], &[7; 16]].concat();
    let replies = session.get(key).payload(request).attachment(beside).timeout(Duration::from_secs(5)).wait();
    let reply = replies.expect("a question").recv().expect("an answer");
    reply.into_result().expect("no refusal").payload().to_bytes().into_owned()
}

/// A request of `softtwin_interfaces/srv/WhatIf` with a load in little-endian CDR: no pressure, no gap, one parameter, no field.
fn what_if(load_n: f64) -> Vec<u8> {
    let absent = f64::NAN.to_le_bytes();
    let one = 1_u32.to_le_bytes();
    // Texts are a multiple of four bytes apart, numbers of eight, counted behind the head of four bytes.
    let name = [&7_u32.to_le_bytes()[..], b"load_n\0\0"].concat();
    [&[0, 1, 0, 0][..], &absent, &absent, &one, &name, &one, &[0; 4], &load_n.to_le_bytes(), &one, &[0]]
        .concat()
}
