//! One page: frames out when it is ready for them, questions in, patience limited on both sides.

use super::catalogue::{Card, Stand};
use super::player::Command;
use super::server::Shared;
use axum::body::Bytes;
use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket, close_code};
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
    /// Another place in the recording.
    Seek { at_s: f64 },
    /// Run or stand still.
    Play { playing: bool },
    /// Another recording, by its name in the folder.
    Open { name: String },
}

/// What a page is told besides frames.
#[derive(Serialize)]
#[serde(tag = "type", rename_all = "lowercase")]
enum Told<'a> {
    Hello {
        version: &'a str,
        models: Vec<&'a Card>,
        #[serde(flatten)]
        stand: &'a Stand,
    },
    Notice {
        text: &'a str,
    },
    Refused {
        text: String,
    },
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
pub async fn serve(mut socket: WebSocket, shared: &Shared) {
    let Some(_place) = shared.hub.enter() else {
        let text = "too many viewers at once; close one of them";
        let _gone_anyway = close(&mut socket, text).await;
        return;
    };
    let mut page = Page { socket, shared, seen: 0, ready: false, second: Instant::now(), messages: 0 };
    if let Err(End::Refused(text)) = page.talk().await {
        let _gone_anyway = close(&mut page.socket, text).await;
    }
}

async fn close(socket: &mut WebSocket, reason: &'static str) -> Result<(), axum::Error> {
    socket.send(Message::Close(Some(CloseFrame { code: close_code::POLICY, reason: reason.into() }))).await
}

struct Page<'a> {
    socket: WebSocket,
    shared: &'a Shared,
    /// Number of the newest frame that was sent.
    seen: u64,
    ready: bool,
    second: Instant,
    messages: u32,
}

impl Page<'_> {
    async fn talk(&mut self) -> Result<(), End> {
        let catalogue = &self.shared.catalogue;
        let models = catalogue.cards();
        let known = !models.is_empty();
        self.tell(&Told::Hello { version: env!("CARGO_PKG_VERSION"), models, stand: catalogue.stand() })
            .await?;
        for mesh in catalogue.meshes() {
            self.send(Message::Binary(Bytes::copy_from_slice(mesh))).await?;
        }
        if !known {
            let text =
                "No model was given, so the surface is unknown and nodes are drawn as points (--model FILE)";
            self.tell(&Told::Notice { text }).await?;
        }
        let mut newest = self.shared.hub.watch();
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
        for frame in self.shared.hub.newer_than(self.seen) {
            self.seen = frame.number;
            let message = match Utf8Bytes::try_from(frame.message.clone()) {
                Ok(text) if frame.is_text => Message::Text(text),
                _ => {
                    self.ready = false;
                    Message::Binary(frame.message)
                }
            };
            self.send(message).await?;
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
                    match self.shared.catalogue.predict(model, pressure_mpa, gap_mm) {
                        Ok(frame) => self.send(Message::Binary(frame.into())).await,
                        Err(text) => self.tell(&Told::Refused { text }).await,
                    }
                }
                Ok(Request::Seek { at_s }) => self.play(Command::Seek(at_s)).await,
                Ok(Request::Play { playing }) => self.play(Command::Play(playing)).await,
                Ok(Request::Open { name }) => self.play(Command::Open(name)).await,
                Err(_) => Err(End::Refused("this is not a message of softtwin view")),
            },
            Message::Binary(_) => Err(End::Refused("this is not a message of softtwin view")),
            Message::Close(_) => Err(End::Gone),
            Message::Ping(_) | Message::Pong(_) => Ok(()),
        }
    }

    /// Passes a wish on to the player of recordings; only recordings of the folder can be opened.
    async fn play(&mut self, command: Command) -> Result<(), End> {
        let Some((library, player)) = &self.shared.player else {
            let text = "this is live; recordings are shown by softtwin view --recording FILE".into();
            return self.tell(&Told::Refused { text }).await;
        };
        if let Command::Open(name) = &command
            && !library.names().contains(name)
        {
            let known = library.names().join(", ");
            let text = format!("expected a recording of the folder ({known}), found {name:?}");
            return self.tell(&Told::Refused { text }).await;
        }
        player.send(command).map_err(|_| End::Gone)
    }

    /// Ends the conversation with a page that floods.
    fn count(&mut self) -> Result<(), End> {
        if self.second.elapsed() > Duration::from_secs(1) {
            (self.second, self.messages) = (Instant::now(), 0);
        }
        self.messages += 1;
        if self.messages > MAX_MESSAGES { Err(End::Refused("too many messages a second")) } else { Ok(()) }
    }

    async fn tell(&mut self, notice: &Told<'_>) -> Result<(), End> {
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
