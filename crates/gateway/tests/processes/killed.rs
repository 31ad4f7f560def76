//! A gateway killed at any system call: the next one starts, no files are left, and the twin continues.

use crate::common::{FAST_SINE, free_port};
use tests::kills::Subject;
use tests::wait::{fresh, states, wait_state};
use tests::{Program, Stage};

#[test]
fn gateway_killed_at_any_call_does_not_delay_others() {
    let stage = Stage::new("kill_gateway");
    let scene = stage.finger(FAST_SINE);
    let (_twin, _bridge) = (Program::twin(&stage, &scene), Program::bridge(&stage, &scene));
    let bus = stage.bus();
    let states = states(&bus);
    wait_state(&states, "a state", fresh);
    let config = format!("listen = [\"tcp/127.0.0.1:{}\"]\n", free_port());
    let config = stage.write("gateway.toml", &config).display().to_string();
    let command = vec!["softtwin-gateway", "--config", &config];
    let mut last = 0;
    Subject { command, ready: "ready:" }.withstands(&stage, || {
        last = wait_state(&states, "a new state", |state| state.seq > last && fresh(state)).seq;
    });
}
