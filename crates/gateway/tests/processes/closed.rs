//! Closed to anything but this machine unless configured with certificates and passwords; wrong configurations.

use crate::common::{FAST_SINE, client, free_port, gateway, gateway_unready, join, subscribe, wait_sample};
use serde_json::{Value, json};
use std::io::Read;
use std::net::TcpStream;
use std::os::unix::fs::PermissionsExt;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use tests::{Program, Stage};

/// A file that only its owner may read.
fn secret(stage: &Stage, name: &str, text: &str) {
    let path = stage.write(name, text);
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o600)).expect("our own file");
}

/// Runs openssl in the stage's folder.
fn openssl(stage: &Stage, arguments: &str) {
    let done = Command::new("openssl").args(arguments.split(' ')).current_dir(stage.folder.path()).output();
    let done = done.expect("openssl is needed for this test; install it (apt-get install openssl)");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
}

/// An authority, and a certificate of it for `localhost`.
fn certificates(stage: &Stage) {
    let key = "-newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes";
    openssl(stage, &format!("req -x509 {key} -keyout ca.key -out ca.pem -days 2 -subj /CN=lab"));
    openssl(stage, &format!("req {key} -keyout gateway.key -out gateway.csr -subj /CN=localhost"));
    stage.write("names.txt", "subjectAltName=DNS:localhost\nbasicConstraints=CA:FALSE\n");
    let signed =
        "x509 -req -in gateway.csr -CA ca.pem -CAkey ca.key -CAcreateserial -out gateway.pem -days 2";
    openssl(stage, &format!("{signed} -extfile names.txt"));
    let key = stage.path("gateway.key");
    std::fs::set_permissions(key, std::fs::Permissions::from_mode(0o600)).expect("our own file");
}

fn with_password(mut settings: Value, user: &str, password: &str) -> Value {
    settings["transport"]["auth"]["usrpwd"] = json!({ "user": user, "password": password });
    settings
}

fn with_authority(mut settings: Value, stage: &Stage, file: &str) -> Value {
    settings["transport"]["link"]["tls"] = json!({ "root_ca_certificate": stage.path(file) });
    settings
}

/// Whether a client with these settings gets states.
fn is_let_in(settings: &Value) -> bool {
    let Ok(session) = join(settings) else { return false };
    wait_sample(&subscribe(&session, "softtwin/finger/state"), "a state", |_| Some(()));
    true
}

#[test]
fn only_known_users_with_the_right_password_are_let_in() {
    let stage = Stage::new("gwuser");
    let scene = stage.finger(FAST_SINE);
    let (_twin, _bridge) = (Program::twin(&stage, &scene), Program::bridge(&stage, &scene));
    let port = free_port();
    secret(&stage, "users.txt", "anna:right\nbob:other\n");
    let _gateway = gateway(
        &stage,
        &format!("listen = [\"tcp/127.0.0.1:{port}\"]\n[security]\nusers_file = \"users.txt\""),
    );
    let plain = client(&format!("tcp/127.0.0.1:{port}"));
    assert!(is_let_in(&with_password(plain.clone(), "anna", "right")));
    for (user, password) in [("anna", "other"), ("bob", "right"), ("carl", "right")] {
        assert!(!is_let_in(&with_password(plain.clone(), user, password)), "{user}");
    }
    assert!(!is_let_in(&plain), "without a password");
}

#[test]
fn idle_connections_are_closed_and_keep_nobody_out() {
    let stage = Stage::new("gwidle");
    let scene = stage.finger(FAST_SINE);
    let (_twin, _bridge) = (Program::twin(&stage, &scene), Program::bridge(&stage, &scene));
    let port = free_port();
    let _gateway = gateway(&stage, &format!("listen = [\"tcp/127.0.0.1:{port}\"]"));
    let idle: Vec<TcpStream> =
        (0..300).map(|_| TcpStream::connect(("127.0.0.1", port)).expect("a connection")).collect();
    assert!(is_let_in(&client(&format!("tcp/127.0.0.1:{port}"))));
    for mut connection in idle {
        connection.set_read_timeout(Some(tests::PATIENCE)).unwrap();
        let read = connection.read(&mut [0]);
        let is_closed = match &read {
            Ok(bytes) => *bytes == 0,
            Err(error) => error.kind() == std::io::ErrorKind::ConnectionReset,
        };
        assert!(is_closed, "{read:?}");
    }
}

/// A connection whose source is this address of the machine.
fn connect_from(source: [u8; 4], port: u16) -> TcpStream {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build().expect("a runtime");
    let connecting = async {
        let socket = tokio::net::TcpSocket::new_v4()?;
        socket.bind((source, 0).into())?;
        socket.connect(([127, 0, 0, 1], port).into()).await?.into_std()
    };
    runtime.block_on(connecting).expect("a connection")
}

fn is_closed(connection: &TcpStream) -> bool {
    // Non-blocking: an open one would block.
    match connection.peek(&mut [0]) {
        Ok(bytes) => bytes == 0,
        Err(error) => error.kind() != std::io::ErrorKind::WouldBlock,
    }
}

/// An address that holds more idle connections than may log in, and opens a new one for each that is closed, keeps no other out.
#[test]
fn idle_connections_of_one_address_keep_no_other_out() {
    let stage = Stage::new("gwaddress");
    let scene = stage.finger(FAST_SINE);
    let (_twin, _bridge) = (Program::twin(&stage, &scene), Program::bridge(&stage, &scene));
    let port = free_port();
    let _gateway = gateway(&stage, &format!("listen = [\"tcp/127.0.0.1:{port}\"]"));
    let is_over = AtomicBool::new(false);
    let (full, is_full) = std::sync::mpsc::channel();
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let mut idle: Vec<TcpStream> = (0..600).map(|_| connect_from([127, 0, 0, 2], port)).collect();
            full.send(()).expect("the test waits");
            while !is_over.load(Ordering::Relaxed) {
                for connection in idle.iter_mut().filter(|connection| is_closed(connection)) {
                    *connection = connect_from([127, 0, 0, 2], port);
                }
                std::thread::sleep(Duration::from_millis(1)); // pace of the connections
            }
        });
        is_full.recv().expect("the connections");
        let end = Instant::now() + tests::PATIENCE;
        let settings = client(&format!("tcp/127.0.0.1:{port}"));
        let is_in =
            std::iter::from_fn(|| (Instant::now() < end).then(|| is_let_in(&settings))).any(|is_in| is_in);
        is_over.store(true, Ordering::Relaxed);
        assert!(is_in, "another address");
    });
}

#[test]
fn with_certificate_and_password_it_opens_to_other_machines() {
    let stage = Stage::new("gwtls");
    let scene = stage.finger(FAST_SINE);
    let (_twin, _bridge) = (Program::twin(&stage, &scene), Program::bridge(&stage, &scene));
    certificates(&stage);
    secret(&stage, "users.txt", "anna:right\n");
    let port = free_port();
    let _gateway = gateway(
        &stage,
        &format!(
            "listen = [\"tls/0.0.0.0:{port}\"]\n[security]\ncertificate = \"gateway.pem\"\nprivate_key = \"gateway.key\"\n\
             users_file = \"users.txt\""
        ),
    );
    let known = with_authority(client(&format!("tls/localhost:{port}")), &stage, "ca.pem");
    assert!(is_let_in(&with_password(known.clone(), "anna", "right")));
    assert!(!is_let_in(&with_password(known.clone(), "anna", "wrong")));
    assert!(!is_let_in(&known), "encrypted, but a stranger");
    openssl(&stage, "req -x509 -newkey rsa:2048 -nodes -keyout no.key -out no.pem -days 2 -subj /CN=other");
    let foreign = with_authority(client(&format!("tls/localhost:{port}")), &stage, "no.pem");
    assert!(!is_let_in(&with_password(foreign, "anna", "right")), "a certificate of another authority");
    let unencrypted = client(&format!("tcp/127.0.0.1:{port}"));
    assert!(!is_let_in(&with_password(unencrypted, "anna", "right")));
}

#[test]
fn a_gateway_shows_who_it_is_when_it_calls() {
    let (stage, hub) = (Stage::new("gwleaf"), Stage::new("gwdoor"));
    let scene = stage.finger(FAST_SINE);
    let (_twin, _bridge) = (Program::twin(&stage, &scene), Program::bridge(&stage, &scene));
    certificates(&hub);
    secret(&hub, "users.txt", "lab1:word\nanna:right\n");
    let port = free_port();
    let _router = gateway(
        &hub,
        &format!(
            "mode = \"router\"\nlisten = [\"tls/127.0.0.1:{port}\"]\n[security]\ncertificate = \"gateway.pem\"\n\
             private_key = \"gateway.key\"\nusers_file = \"users.txt\""
        ),
    );
    std::fs::copy(hub.path("ca.pem"), stage.path("ca.pem")).unwrap();
    secret(&stage, "password.txt", "word\n");
    let _leaf = gateway(
        &stage,
        &format!(
            "mode = \"client\"\nconnect = [\"tls/localhost:{port}\"]\n[security]\nroot_certificate = \"ca.pem\"\n\
             user = \"lab1\"\npassword_file = \"password.txt\""
        ),
    );
    let far = with_authority(client(&format!("tls/localhost:{port}")), &hub, "ca.pem");
    assert!(is_let_in(&with_password(far, "anna", "right")));
}

/// Starts a gateway that must refuse its configuration, and returns what it said.
fn refused(stage: &Stage, config: &str) -> String {
    let (status, said) = gateway_unready(stage, config).ended();
    let said = said.join("\n");
    assert_eq!(status.code(), Some(78), "{said}");
    said
}

#[test]
fn wrong_configurations_are_refused_with_all_errors() {
    let stage = Stage::new("gwbad");
    let expect = |config: &str, wanted: &[&str]| {
        let said = refused(&stage, config);
        for word in wanted {
            assert!(said.contains(word), "`{word}` is not in:\n{said}");
        }
    };
    expect("listne = []", &["unknown field `listne`", "line 1"]);
    expect(
        "listen = [\"tcp/0.0.0.0:7447\"]",
        &["leaves this machine", "needs tls/", "security.users_file (missing)"],
    );
    expect(
        "listen = [\"tls/0.0.0.0:7447\"]",
        &["2 problems", "users_file (missing)", "security.certificate"],
    );
    expect(
        "connect = [\"tcp/lab:7447\"]",
        &["connect tcp/lab:7447: leaves this machine", "password_file (missing)"],
    );
    expect("listen = []", &["expected at least one endpoint"]);
    expect("mode = \"client\"", &["expected the endpoint of a router"]);
    // Seen with the settings of ROS 2's router: scripts/check.sh ros2-peer.
    let called = "connect = [\"tcp/127.0.0.1:1\"]\n[ros2]";
    expect(&format!("listen = []\n{called}"), &["mode: expected \"client\", found \"peer\""]);
    expect(called, &["mode: expected \"router\", found \"peer\""]);
    expect("[security]\nuser = \"a\"", &["user and password_file go together"]);
    expect("[security]\nusers_file = \"none.txt\"", &["users_file", "cannot be read"]);
    stage.write("open.txt", "a:b\n");
    std::fs::set_permissions(stage.path("open.txt"), std::fs::Permissions::from_mode(0o644)).unwrap();
    expect("[security]\nusers_file = \"open.txt\"", &["chmod 600"]);
    secret(&stage, "odd.txt", "a:b\nonly a name\n");
    expect("[security]\nusers_file = \"odd.txt\"", &["entry 2"]);
    secret(&stage, "empty.txt", "\n");
    expect("[security]\nusers_file = \"empty.txt\"", &["found none"]);
    expect(
        "listen = [\"udp/127.0.0.1:1\"]\nprefix = \"a//b\"\nkeys = [\"\"]\nfield_rate_hz = 0\nreadings_from_network = [\"a/b\", \"c\", \"c\"]",
        &[
            "6 problems",
            "expected tcp/<host>:<port>",
            "prefix:",
            "keys:",
            "field_rate_hz",
            "a/b",
            "\"c\" twice",
        ],
    );
}

#[test]
fn committed_configuration_lists_the_defaults() {
    let repository = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap();
    let stage = Stage::new("gwdefault");
    let check = |path: &std::path::Path| {
        let (status, said) =
            Program::shell(&stage, &format!("exec softtwin-gateway --check --config {}", path.display()))
                .ended();
        assert!(status.success(), "{said:?}");
        said
    };
    let committed = check(&repository.join("config/gateway.toml"));
    let empty = check(&stage.write("empty.toml", ""));
    assert_eq!(committed, empty);
    assert!(committed[0].contains("127.0.0.1"), "{committed:?}");
}

#[test]
fn occupied_port_is_named() {
    let stage = Stage::new("gwport");
    let held = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = held.local_addr().unwrap().port();
    let (status, said) = gateway_unready(&stage, &format!("listen = [\"tcp/127.0.0.1:{port}\"]")).ended();
    assert_eq!(status.code(), Some(1), "{said:?}");
    assert!(said.join("\n").contains("is the port taken"), "{said:?}");
}

#[test]
fn a_client_without_its_router_waits_and_can_be_stopped() {
    let stage = Stage::new("gwwait");
    let port = free_port();
    let mut waiting =
        gateway_unready(&stage, &format!("mode = \"client\"\nconnect = [\"tcp/127.0.0.1:{port}\"]"));
    waiting.wait_for("no answer");
    let (status, said) = waiting.stop();
    assert!(status.success(), "{said:?}");
}
