//! SIGHUP: the configuration is read again, with users; an invalid one is refused and the old one stays. `softtwin doctor` checks it.

use crate::common::{FAST_SINE, client, far_end, free_port, gateway, join, json_of, subscribe, wait_sample};
use serde_json::json;
use std::os::unix::fs::PermissionsExt;
use tests::{Program, Stage};

/// Linux signal numbers.
const SIGHUP: i32 = 1;

#[test]
fn a_reload_takes_the_new_configuration_or_keeps_the_old_one() {
    let stage = Stage::new("gwreload");
    let scene = stage.finger(FAST_SINE);
    let (_twin, _bridge) = (Program::twin(&stage, &scene), Program::bridge(&stage, &scene));
    let (first, second) = (free_port(), free_port());
    let config =
        |port: u16, prefix: &str| format!("listen = [\"tcp/127.0.0.1:{port}\"]\nprefix = \"{prefix}\"");
    let mut gateway = gateway(&stage, &config(first, "one"));
    let session = far_end(first);
    let before = subscribe(&session, "one/softtwin/finger/state");
    let seq = |sample: &zenoh::sample::Sample| json_of(sample)["seq"].as_u64();
    wait_sample(&before, "a state", seq);
    // Damaged, of an unknown key, of an address that is refused: each is said, and states go on.
    for (wrong, why) in [
        ("listen = [", "gateway.toml"),
        ("listne = []", "unknown field `listne`"),
        ("listen = [\"tcp/0.0.0.0:7447\"]", "leaves this machine"),
    ] {
        stage.write("gateway.toml", wrong);
        gateway.signal(SIGHUP);
        let line = gateway.wait_for("reload refused, the old configuration stays");
        let rest = if line.contains(why) { line } else { gateway.wait_for(why) };
        assert!(rest.contains(why), "{rest}");
        before.try_iter().for_each(drop);
        wait_sample(&before, "a state of the old configuration", seq);
    }
    stage.write("gateway.toml", &config(second, "two"));
    gateway.signal(SIGHUP);
    gateway.wait_for("reloaded: reconnecting");
    gateway.wait_for("ready:");
    let session = far_end(second);
    let after = subscribe(&session, "*/softtwin/finger/state");
    wait_sample(&after, "a state below the new prefix", |sample| {
        assert_eq!(sample.key_expr().as_str(), "two/softtwin/finger/state");
        Some(())
    });
    assert!(
        std::net::TcpStream::connect(("127.0.0.1", first)).is_err(),
        "it listens where it listened before"
    );
    let (status, said) = gateway.stop();
    assert!(status.success(), "{said:?}");
}

#[test]
fn users_are_read_again() {
    let stage = Stage::new("gwusers");
    let scene = stage.finger(FAST_SINE);
    let (_twin, _bridge) = (Program::twin(&stage, &scene), Program::bridge(&stage, &scene));
    let users = |text: &str| {
        let path = stage.write("users.txt", text);
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o600)).expect("our own file");
    };
    users("anna:right\n");
    let port = free_port();
    let config = format!("listen = [\"tcp/127.0.0.1:{port}\"]\n[security]\nusers_file = \"users.txt\"");
    let mut gateway = gateway(&stage, &config);
    let is_let_in = |user: &str| {
        let mut settings = client(&format!("tcp/127.0.0.1:{port}"));
        settings["transport"]["auth"]["usrpwd"] = json!({ "user": user, "password": "right" });
        let Ok(session) = join(&settings) else { return false };
        wait_sample(&subscribe(&session, "softtwin/finger/state"), "a state", |_| Some(()));
        true
    };
    assert!(is_let_in("anna") && !is_let_in("bob"));
    users("bob:right\n");
    gateway.signal(SIGHUP);
    gateway.wait_for("reloaded: reconnecting");
    gateway.wait_for("ready:");
    assert!(is_let_in("bob") && !is_let_in("anna"));
}

#[test]
fn doctor_reports_the_gateways_configuration_errors() {
    let stage = Stage::new("gwdoctor");
    let doctor = |config: &str| {
        let path = stage.write("gateway.toml", config).display().to_string();
        let (status, said) = Program::tool(&stage, &["doctor", "--gateway", &path]).ended();
        (status.code(), said.join("\n"))
    };
    let (_, good) = doctor(&format!("listen = [\"tcp/127.0.0.1:{}\"]", free_port()));
    assert!(good.contains("ok    gateway: ") && good.contains("listens on tcp/127.0.0.1"), "{good}");
    let (code, bad) = doctor("listen = [\"tcp/0.0.0.0:7447\"]");
    assert_eq!(code, Some(1), "{bad}");
    assert!(bad.contains("BAD   gateway: "), "{bad}");
}
