//! One page: frames out when it is ready for them, questions in, patience limited on both sides.

use super::catalogue::{Card, Catalogue};
use super::hub::Hub;
use axum::body::Bytes;
use axum::extract::ws::{CloseFrame, Message, WebSocket, close_code};
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};

/// A page that does not take a message for this long is gone.
const PATIENCE: Duration = Duration::from_secs(10);
/// Messages a second that a page may send: a mouse and two sliders stay far below.
const MAX_MESSAGES: u32 = 500;

/// What a page may say.
#[derive(Debug, Deserialize)]
#[serde(tag = "type", rename_all = "lowercase", deny_unknown_fields)]
enum Request {
    /// The last frames are drawn.
    Ready {},
    /// A prediction is wanted; no gap: no plate.
    Predict { model: usize, pressure_mpa: f64, gap_mm: Option<f64> },
}

/// What a page is told besides frames.
#[derive(Serialize)]
#[serde(tag = "type", rename_all = "lowercase")]
enum Notice<'a> {
    Hello { version: &'a str, models: Vec<&'a Card> },
    Notice { text: &'a str },
    Refused { text: String },
}

/// Why a conversation ended.
#[derive(Debug)]
enum End {
    /// The page went away or does not listen any more.
    Gone,
    /// The page broke the rules; it is told which.
    Refused(&'static str),
}

/// Talks to one page until it goes.
pub async fn serve(mut socket: WebSocket, catalogue: &Catalogue, hub: &Hub) {
    let Some(_place) = hub.enter() else {
        let text = "too many viewers at once; close one of them";
        let _gone_anyway = close(&mut socket, text).await;
        return;
    };
    let mut page =
        Page { socket, catalogue, hub, seen: 0, ready: false, second: Instant::now(), messages: 0 };
    if let Err(End::Refused(text)) = page.talk().await {
        let _gone_anyway = close(&mut page.socket, text).await;
    }
}

async fn close(socket: &mut WebSocket, reason: &'static str) -> Result<(), axum::Error> {
    socket.send(Message::Close(Some(CloseFrame { code: close_code::POLICY, reason: reason.into() }))).await
}

struct Page<'a> {
    socket: WebSocket,
    catalogue: &'a Catalogue,
    hub: &'a Hub,
    /// Number of the newest frame that was sent.
    seen: u64,
    ready: bool,
    second: Instant,
    messages: u32,
}

impl Page<'_> {
    async fn talk(&mut self) -> Result<(), End> {
        let models = self.catalogue.cards();
        let known = !models.is_empty();
        self.tell(&Notice::Hello { version: env!("CARGO_PKG_VERSION"), models }).await?;
        let catalogue = self.catalogue;
        for mesh in catalogue.meshes() {
            self.send(Message::Binary(Bytes::copy_from_slice(mesh))).await?;
        }
        if !known {
            let text =
                "No model was given, so the surface is unknown and nodes are drawn as points (--model FILE)";
            self.tell(&Notice::Notice { text }).await?;
        }
        let mut newest = self.hub.watch();
        loop {
            tokio::select! {
                message = self.socket.recv() => self.hear(message).await?,
                changed = newest.changed(), if self.ready => {
                    changed.map_err(|_| End::Gone)?;
                    self.show().await?;
                }
            }
        }
    }

    /// Sends what is newer than what the page has.
    async fn show(&mut self) -> Result<(), End> {
        for frame in self.hub.newer_than(self.seen) {
            self.seen = frame.number;
            self.ready = false;
            self.send(Message::Binary(frame.message)).await?;
        }
        Ok(())
    }

    async fn hear(&mut self, message: Option<Result<Message, axum::Error>>) -> Result<(), End> {
        let Some(Ok(message)) = message else { return Err(End::Gone) };
        self.count()?;
        match message {
            Message::Text(text) => match serde_json::from_str(&text) {
                Ok(Request::Ready {}) => {
                    self.ready = true;
                    self.show().await
                }
                Ok(Request::Predict { model, pressure_mpa, gap_mm }) => {
                    match self.catalogue.predict(model, pressure_mpa, gap_mm) {
                        Ok(frame) => self.send(Message::Binary(frame.into())).await,
                        Err(text) => self.tell(&Notice::Refused { text }).await,
                    }
                }
                Err(_) => Err(End::Refused("this is not a message of softtwin view")),
            },
            Message::Binary(_) => Err(End::Refused("this is not a message of softtwin view")),
            Message::Close(_) => Err(End::Gone),
            Message::Ping(_) | Message::Pong(_) => Ok(()),
        }
    }

    /// Ends the conversation with a page that floods.
    fn count(&mut self) -> Result<(), End> {
        if self.second.elapsed() > Duration::from_secs(1) {
            (self.second, self.messages) = (Instant::now(), 0);
        }
        self.messages += 1;
        if self.messages > MAX_MESSAGES { Err(End::Refused("too many messages a second")) } else { Ok(()) }
    }

    async fn tell(&mut self, notice: &Notice<'_>) -> Result<(), End> {
        let text = serde_json::to_string(notice).map_err(|_| End::Gone)?;
        self.send(Message::Text(text.into())).await
    }

    async fn send(&mut self, message: Message) -> Result<(), End> {
        match tokio::time::timeout(PATIENCE, self.socket.send(message)).await {
            Ok(Ok(())) => Ok(()),
            _ => Err(End::Gone),
        }
    }
}
