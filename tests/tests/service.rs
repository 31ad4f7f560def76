//! The daemon under a service manager: ready, watchdog, stopping, over a real notification socket.

use softtwin_tests::{PATIENCE, Program, Stage};
use std::os::unix::net::UnixDatagram;

/// Waits for a message that contains `text`.
fn wait_for(socket: &UnixDatagram, text: &str) -> String {
    let mut buffer = [0; 1024];
    loop {
        let length =
            socket.recv(&mut buffer).unwrap_or_else(|error| panic!("`{text}` did not come: {error}"));
        let message = String::from_utf8_lossy(&buffer[..length]).into_owned();
        if message.contains(text) {
            return message;
        }
    }
}

#[test]
fn the_manager_hears_ready_watchdog_and_stopping() {
    let stage = Stage::new("notify");
    let scene = stage.finger("kind = \"simulate\"").display().to_string();
    let path = stage.path("notify.sock");
    let socket = UnixDatagram::bind(&path).unwrap();
    socket.set_read_timeout(Some(PATIENCE)).unwrap();
    let environment = [("NOTIFY_SOCKET", path.display().to_string()), ("WATCHDOG_USEC", "200000".to_owned())];
    let twin = Program::daemon_with(&stage, &["twin", "--scene", &scene], &environment);
    let ready = wait_for(&socket, "READY=1");
    assert!(ready.contains("STATUS=twin of scene finger: finger"), "{ready}");
    wait_for(&socket, "WATCHDOG=1");
    wait_for(&socket, "WATCHDOG=1"); // again and again, not once
    twin.signal(libc::SIGTERM);
    wait_for(&socket, "STOPPING=1");
    let (status, said) = twin.ended();
    assert!(status.success(), "{said:?}");
}
