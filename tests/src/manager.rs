//! A service manager's end of the line.

use crate::{PATIENCE, Stage};
use std::os::unix::net::UnixDatagram;
use std::time::Duration;

/// Listens to what one program tells.
#[derive(Debug)]
pub struct Manager {
    socket: UnixDatagram,
    path: String,
}

impl Manager {
    /// One in this stage.
    ///
    /// # Panics
    /// When the stage's folder refuses a socket.
    pub fn new(stage: &Stage) -> Self {
        let path = stage.path("notify.sock");
        let _none_yet = std::fs::remove_file(&path);
        Self { socket: UnixDatagram::bind(&path).expect("our own folder"), path: path.display().to_string() }
    }

    /// The environment of a service of `Type=notify` with a watchdog of 0.4 s.
    pub fn environment(&self) -> [(&'static str, String); 2] {
        [("NOTIFY_SOCKET", self.path.clone()), ("WATCHDOG_USEC", "400000".to_owned())]
    }

    /// What is told, up to the message with `text` in it.
    ///
    /// # Panics
    /// When it does not come within [`PATIENCE`].
    pub fn told(&self, text: &str) -> Vec<String> {
        let mut messages = Vec::new();
        while !messages.last().is_some_and(|message: &String| message.contains(text)) {
            let message = self.next(PATIENCE);
            messages.push(message.unwrap_or_else(|| panic!("`{text}` was not told: {messages:?}")));
        }
        messages
    }

    /// The next message, if one comes in time.
    ///
    /// # Panics
    /// When `patience` is zero.
    pub fn next(&self, patience: Duration) -> Option<String> {
        self.socket.set_read_timeout(Some(patience)).expect("not zero");
        let mut bytes = [0; 4096];
        let count = self.socket.recv(&mut bytes).ok()?;
        Some(String::from_utf8_lossy(&bytes[..count]).into_owned())
    }
}
