//! Receiver of service-manager notifications (`sd_notify`).

use crate::{PATIENCE, Stage};
use std::os::unix::net::UnixDatagram;
use std::time::Duration;

/// Notification socket of one program.
#[derive(Debug)]
pub struct Manager {
    socket: UnixDatagram,
    path: String,
}

impl Manager {
    /// Binds a socket in the stage's folder.
    ///
    /// # Panics
    /// If the socket cannot be bound.
    pub fn new(stage: &Stage) -> Self {
        let path = stage.path("notify.sock");
        let _none_yet = std::fs::remove_file(&path);
        Self { socket: UnixDatagram::bind(&path).expect("our own folder"), path: path.display().to_string() }
    }

    /// Environment of a service of `Type=notify` with a watchdog of 0.4 s.
    pub fn environment(&self) -> [(&'static str, String); 2] {
        [("NOTIFY_SOCKET", self.path.clone()), ("WATCHDOG_USEC", "400000".to_owned())]
    }

    /// Receives notifications up to the one that contains `text`.
    ///
    /// # Panics
    /// If it does not arrive within [`PATIENCE`].
    pub fn receive(&self, text: &str) -> Vec<String> {
        let mut messages = Vec::new();
        while !messages.last().is_some_and(|message: &String| message.contains(text)) {
            let message = self.next(PATIENCE);
            messages.push(message.unwrap_or_else(|| panic!("`{text}` was not received: {messages:?}")));
        }
        messages
    }

    /// Next notification; `None` after `patience`.
    ///
    /// # Panics
    /// If `patience` is zero.
    pub fn next(&self, patience: Duration) -> Option<String> {
        self.socket.set_read_timeout(Some(patience)).expect("not zero");
        let mut bytes = [0; 4096];
        let count = self.socket.recv(&mut bytes).ok()?;
        Some(String::from_utf8_lossy(&bytes[..count]).into_owned())
    }
}
