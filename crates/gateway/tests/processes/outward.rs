//! From a twin to the far end: states, fields, answers, liveliness; twins, gateways and routers that come and go.

use crate::common::{
    FAST_SINE, far_end, free_port, gateway, get, get_until, json_of, living, subscribe, wait_sample,
};
use std::collections::HashMap;
use tests::wait::{states, wait_for, wait_until};
use tests::{Program, Stage};
use wire::{FieldReader, KeyExpr, Topic};
use zenoh::Wait;

fn listen(port: u16) -> String {
    format!("listen = [\"tcp/127.0.0.1:{port}\"]\n")
}

#[test]
fn every_state_arrives_once_in_order_and_to_the_bit() {
    let stage = Stage::new("gwstate");
    let scene = stage.finger(FAST_SINE);
    let _twin = Program::twin(&stage, &scene);
    let port = free_port();
    let _gateway = gateway(&stage, &listen(port));
    let session = far_end(port);
    let far = subscribe(&session, "softtwin/*/state");
    let bus = stage.bus();
    let local = states(&bus);
    let _bridge = Program::bridge(&stage, &scene);
    let (mut near, mut seen) = (HashMap::new(), Vec::new());
    wait_sample(&far, "600 states", |sample| {
        while let Some(state) = local.next().expect("readable") {
            near.insert(state.seq, state.contact_force_n.to_bits());
        }
        assert_eq!(sample.key_expr().as_str(), "softtwin/finger/state");
        assert_eq!(sample.encoding().to_string(), "application/json");
        let state = json_of(sample);
        seen.push((state["seq"].as_u64().expect("a number"), state["contact_force_n"].as_f64()));
        (seen.len() >= 600).then_some(())
    });
    let first = seen[0].0;
    assert!(
        seen.iter().zip(first..).all(|((seq, _), expected)| *seq == expected),
        "a state is missing or twice"
    );
    let same = |(seq, force): &&(u64, Option<f64>)| near.get(seq).copied() == force.map(f64::to_bits);
    // The first ones have no force yet, and the last ones may have come here first.
    let same = seen.iter().filter(same).count();
    assert!(same > 500, "only {same} of 600 states are what they were");
}

#[test]
fn fields_are_read_only_with_a_subscriber_and_arrive_bit_identical() {
    let stage = Stage::new("gwfield");
    let scene = stage.finger(FAST_SINE);
    let _twin = Program::twin(&stage, &scene);
    let _bridge = Program::bridge(&stage, &scene);
    let port = free_port();
    let gateway = gateway(&stage, &listen(port));
    let session = far_end(port);
    let bus = stage.bus();
    let topic = Topic::field("finger", None).unwrap();
    let is_read = |topic: &Topic| {
        let found = bus.topics(&KeyExpr::new(topic.name()).unwrap()).unwrap();
        found.iter().any(|info| info.readers.contains(&gateway.id()))
    };
    let state = Topic::state("finger").unwrap();
    // An answer shows that the gateway knows the twin; there is no request for a field and no subscriber.
    get_until(&session, "softtwin/finger/whatif?pressure_mpa=0.03;gap_mm=30", |answer| answer.ok());
    assert!(!is_read(&topic) && !is_read(&state), "read without a subscriber");
    let far = session.declare_subscriber("softtwin/finger/field").wait().unwrap();
    let reader = FieldReader::open(&bus, &topic).unwrap();
    let mut local = HashMap::new();
    wait_for(&reader, "a field that came both ways", |reader| {
        while let Some(sample) = reader.next().unwrap() {
            local.insert(sample.header().seq, sample.values().to_vec());
        }
        let sample = far.try_recv().ok().flatten()?;
        let header: serde_json::Value =
            serde_json::from_slice(&sample.attachment().unwrap().to_bytes()).unwrap();
        assert_eq!(header["fields"], serde_json::json!(["x", "y", "z", "displacement", "von_mises"]));
        let values = local.get(&header["seq"].as_u64().unwrap())?;
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        assert!(bytes == *sample.payload().to_bytes(), "a field was changed on its way");
        assert_eq!(values.len() as u64, 5 * header["node_count"].as_u64().unwrap());
        Some(())
    });
    assert!(is_read(&topic));
    far.undeclare().wait().unwrap();
    wait_until("the gateway lets go of the field", || (!is_read(&topic)).then_some(()));
    // On demand, without a subscription.
    let sample = get(&session, "softtwin/finger/field/tip").expect("an answer").expect("a field");
    let header: serde_json::Value = serde_json::from_slice(&sample.attachment().unwrap().to_bytes()).unwrap();
    assert_eq!(header["node_set"], "tip");
    assert_eq!(sample.payload().len() as u64, 4 * 2 * header["node_count"].as_u64().unwrap());
}

#[test]
fn fields_come_at_the_rate_that_was_asked_for() {
    let stage = Stage::new("gwrate");
    let scene = stage.finger(FAST_SINE);
    let _twin = Program::twin(&stage, &scene);
    let _bridge = Program::bridge(&stage, &scene);
    let port = free_port();
    let _gateway = gateway(&stage, &format!("{}field_rate_hz = 10.0", listen(port)));
    let session = far_end(port);
    let far = subscribe(&session, "softtwin/finger/field");
    let mut stamps: Vec<u64> = Vec::new();
    wait_sample(&far, "20 fields", |sample| {
        let header: serde_json::Value = serde_json::from_slice(&sample.attachment()?.to_bytes()).ok()?;
        stamps.push(header["t_publish_ns"].as_u64()?);
        (stamps.len() == 20).then_some(())
    });
    // By the twin's own stamps, so that a slow machine between it and us does not count; the first may be older.
    let rate_hz = 18.0 / ((stamps[19] - stamps[1]) as f64 * 1e-9);
    assert!(rate_hz < 11.0, "{rate_hz} Hz although 10 were asked for");
}

#[test]
fn questions_are_answered_as_they_are_locally() {
    let stage = Stage::new("gwask");
    let scene = stage.finger(FAST_SINE);
    let twin = Program::twin(&stage, &scene);
    let port = free_port();
    let _gateway = gateway(&stage, &listen(port));
    let session = far_end(port);
    let selector = "softtwin/finger/whatif?pressure_mpa=0.05;gap_mm=30";
    let far = json_of(&get_until(&session, selector, Result::ok));
    let (status, said) = Program::tool(&stage, &["get", "--json", selector]).end();
    assert!(status.success(), "{said:?}");
    let near: serde_json::Value = serde_json::from_str(said.last().unwrap()).unwrap();
    for name in ["contact_force_n", "force_halfwidth_n", "regime", "onset_pressure_mpa", "coefficients"] {
        assert_eq!(far[name], near[name], "{name}");
    }
    let inverse = get(&session, "softtwin/finger/pressure?force_n=0.1;gap_mm=30").unwrap().unwrap();
    assert!(json_of(&inverse)["pressure_mpa"].as_f64().unwrap() > 0.0);
    let refused = get(&session, "softtwin/finger/pressure?force_n=900;gap_mm=30").unwrap().unwrap();
    assert!(json_of(&refused)["refusal"].is_string(), "an answer that says why there is none");
    for (wrong, expected) in
        [("whatif?pressure_mpa=oops", "expected a finite number"), ("whatif?gap_mm=3", "needs pressure_mpa")]
    {
        let text = get(&session, &format!("softtwin/finger/{wrong}")).unwrap().unwrap_err();
        assert!(text.contains(expected), "{text}");
    }
    let state = get(&session, "softtwin/finger/state").unwrap().expect("the newest state");
    assert!(json_of(&state)["flags"].as_array().unwrap().contains(&"no-data".into()), "no reading came yet");
    twin.kill();
    let text = get_until(&session, selector, Result::err);
    assert!(text.contains("softtwin/finger"), "{text}");
    let _twin = Program::twin(&stage, &scene);
    get_until(&session, selector, Result::ok);
}

#[test]
fn a_killed_twin_is_missed_and_its_successor_is_heard_without_a_new_subscription() {
    let stage = Stage::new("gwtwin");
    let scene = stage.finger(FAST_SINE);
    let twin = Program::twin(&stage, &scene);
    let _bridge = Program::bridge(&stage, &scene);
    let port = free_port();
    let _gateway = gateway(&stage, &listen(port));
    let session = far_end(port);
    let far = subscribe(&session, "softtwin/finger/state");
    let run = |sample: &zenoh::sample::Sample| json_of(sample)["boot_id"].as_str().map(str::to_owned);
    let first = wait_sample(&far, "a state", run);
    let alive = || living(&session, "softtwin/*/alive");
    assert_eq!(alive(), ["softtwin/finger/alive"]);
    twin.kill();
    wait_until("the twin's token goes", || alive().is_empty().then_some(()));
    let _twin = Program::twin(&stage, &scene);
    let mut seqs = Vec::new();
    wait_sample(&far, "states of the second twin", |sample| {
        if run(sample).as_ref() != Some(&first) {
            seqs.push(json_of(sample)["seq"].as_u64().unwrap());
        }
        (seqs.len() == 100).then_some(())
    });
    assert_eq!(seqs, (1..=100).collect::<Vec<u64>>(), "the second twin was heard from its first state on");
    wait_until("the token comes back", || (alive() == ["softtwin/finger/alive"]).then_some(()));
}

#[test]
fn a_killed_gateway_takes_its_tokens_along_and_its_successor_serves_the_same_subscription() {
    let stage = Stage::new("gwkill");
    let scene = stage.finger(FAST_SINE);
    let _twin = Program::twin(&stage, &scene);
    let _bridge = Program::bridge(&stage, &scene);
    let port = free_port();
    let first = gateway(&stage, &listen(port));
    let session = far_end(port);
    let far = subscribe(&session, "softtwin/finger/state");
    let tokens = session.liveliness().declare_subscriber("softtwin/*/alive").history(true).wait().unwrap();
    let kind = || tokens.recv().expect("a token").kind();
    assert_eq!(kind(), zenoh::sample::SampleKind::Put);
    wait_sample(&far, "a state", |_| Some(()));
    first.kill();
    assert_eq!(kind(), zenoh::sample::SampleKind::Delete, "the token of the twin ends");
    let before: Vec<_> = far.try_iter().collect();
    drop(before);
    let second = gateway(&stage, &listen(port));
    wait_sample(&far, "a state through the second gateway", |_| Some(()));
    assert_eq!(kind(), zenoh::sample::SampleKind::Put);
    let (status, said) = second.stop();
    assert!(status.success(), "{said:#?}");
    assert!(said.iter().any(|line| line.contains("ended:") && line.contains(" lost=0 ")), "{said:#?}");
}

#[test]
fn two_machines_share_a_key_space_over_a_router_that_comes_and_goes() {
    let (one, two, hub) = (Stage::new("gwone"), Stage::new("gwtwo"), Stage::new("gwhub"));
    let port = free_port();
    let router = format!("mode = \"router\"\n{}", listen(port));
    let leaf = |prefix: &str| {
        format!("mode = \"client\"\nconnect = [\"tcp/127.0.0.1:{port}\"]\nprefix = \"{prefix}\"")
    };
    let mut programs = Vec::new();
    let mut leaves = Vec::new();
    for (stage, prefix) in [(&one, "lab1"), (&two, "lab2")] {
        let scene = stage.finger(FAST_SINE);
        programs.push(Program::twin(stage, &scene));
        programs.push(Program::bridge(stage, &scene));
        leaves.push(crate::common::gateway_unready(stage, &leaf(prefix)));
    }
    let first = gateway(&hub, &router);
    for leaf in &mut leaves {
        leaf.wait_for("ready:");
    }
    let session = far_end(port);
    let far = subscribe(&session, "*/softtwin/finger/state");
    let both = || {
        let mut seen = std::collections::BTreeSet::new();
        wait_sample(&far, "states of both machines", |sample| {
            seen.insert(sample.key_expr().as_str().to_owned());
            (seen.len() == 2).then_some(())
        });
        seen.into_iter().collect::<Vec<_>>()
    };
    let keys = ["lab1/softtwin/finger/state", "lab2/softtwin/finger/state"];
    assert_eq!(both(), keys);
    let tokens = ["lab1/softtwin/finger/alive", "lab2/softtwin/finger/alive"];
    assert_eq!(living(&session, "*/softtwin/*/alive"), tokens);
    first.kill();
    wait_until("the router is missed", || living(&session, "*/softtwin/*/alive").is_empty().then_some(()));
    while far.try_recv().is_ok() {}
    let _second = gateway(&hub, &router);
    assert_eq!(both(), keys, "both reconnected");
    wait_until("both twins are announced again", || {
        (living(&session, "*/softtwin/*/alive") == tokens).then_some(())
    });
}
