//! One page: it gets frames when it is ready for them and sends requests. Time and number of its messages are limited.

use crate::catalogue::{Catalogue, Stand};
use crate::hub::Hub;
use crate::pictures::Picture;
use crate::player::{Command, Library};
use crate::readings::Cursors;
use axum::body::Bytes;
use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket, close_code};
use page::Card;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::mpsc::Sender;
use std::time::{Duration, Instant};

/// A page that does not accept a message for this long is gone.
const SEND_TIMEOUT: Duration = Duration::from_secs(10);
/// Messages a second that a page may send; a mouse and two sliders send far fewer.
const MAX_MESSAGES: u32 = 500;

/// Context of the task of one browser.
#[derive(Clone)]
pub struct Shared {
    /// Pictures under `/pictures`.
    pub pictures: Arc<[Picture]>,
    /// Known models.
    pub catalogue: Arc<Catalogue>,
    /// The newest frames.
    pub hub: Arc<Hub>,
    /// The recordings that may be opened and who plays them, when recordings are shown instead of live topics.
    pub player: Option<(Library, Sender<Command>)>,
}

/// Messages from a browser.
#[derive(Debug, Deserialize)]
#[serde(tag = "type", rename_all = "lowercase", deny_unknown_fields)]
enum Request {
    /// The last frames are drawn.
    Ready {},
    /// Data read since the last call.
    Readings {},
    /// Predict a state from the values of the model's inputs by key (`pressure_mpa`); no gap: no plate.
    Predict { model: usize, inputs: BTreeMap<String, f64> },
    /// Go to another time of the recording.
    Seek { at_s: f64 },
    /// Run or stand still.
    Play { playing: bool },
    /// Open another recording, by its name in the folder.
    Open { name: String },
}

/// True if the string is a request that a browser may send.
pub fn is_request(text: &str) -> bool {
    serde_json::from_str::<Request>(text).is_ok()
}

/// Messages to a browser other than frames.
#[derive(Serialize)]
#[serde(tag = "type", rename_all = "lowercase")]
enum Notification<'a> {
    Hello {
        version: &'a str,
        models: Vec<&'a Card>,
        pictures: usize,
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

/// Why a connection ended.
#[derive(Debug)]
enum End {
    /// The browser closed the connection or does not read any more.
    Gone,
    /// The browser broke a rule; it receives the text.
    Refused(&'static str),
}

/// Serves one page until it goes.
pub async fn serve(mut socket: WebSocket, shared: &Shared) {
    let Some(_viewer) = shared.hub.enter() else {
        let text = "too many viewers at once; close one of them";
        let _is_gone_anyway = close(&mut socket, text).await;
        return;
    };
    let mut page = Page {
        socket,
        shared,
        seen: 0,
        cursors: Cursors::new(),
        ready: false,
        second: Instant::now(),
        messages: 0,
    };
    if let Err(End::Refused(text)) = page.run().await {
        let _is_gone_anyway = close(&mut page.socket, text).await;
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
    /// How many readings of each actuator were sent.
    cursors: Cursors,
    ready: bool,
    second: Instant,
    messages: u32,
}

impl Page<'_> {
    async fn run(&mut self) -> Result<(), End> {
        let catalogue = &self.shared.catalogue;
        let models = catalogue.cards();
        let known = !models.is_empty();
        self.notify(&Notification::Hello {
            version: env!("CARGO_PKG_VERSION"),
            models,
            pictures: self.shared.pictures.len(),
            stand: catalogue.stand(),
        })
        .await?;
        for mesh in catalogue.meshes() {
            self.send(Message::Binary(Bytes::copy_from_slice(mesh))).await?;
        }
        if !known {
            let text = "No model was given, so the surface is unknown and nodes are drawn as points. To see the surface: `softtwin view FILE.twin`";
            self.notify(&Notification::Notice { text }).await?;
        }
        let mut newest = self.shared.hub.watch();
        loop {
            tokio::select! {
                message = self.socket.recv() => self.receive(message).await?,
                changed = newest.changed(), if self.ready => {
                    changed.map_err(|_| End::Gone)?;
                    self.show().await?;
                }
            }
        }
    }

    /// Sends what is newer than what the browser has.
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

    async fn receive(&mut self, message: Option<Result<Message, axum::Error>>) -> Result<(), End> {
        let Some(Ok(message)) = message else { return Err(End::Gone) };
        self.count()?;
        match message {
            Message::Text(text) => match serde_json::from_str(&text) {
                Ok(Request::Ready {}) => {
                    self.ready = true;
                    self.show().await
                }
                Ok(Request::Readings {}) => {
                    for message in self.shared.hub.readings_since(&mut self.cursors) {
                        self.send(Message::Binary(message.into())).await?;
                    }
                    Ok(())
                }
                Ok(Request::Predict { model, inputs }) => {
                    match self.shared.catalogue.predict(model, &inputs) {
                        Ok(frame) => self.send(Message::Binary(frame.into())).await,
                        Err(text) => self.notify(&Notification::Refused { text }).await,
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

    /// Passes a command on to the player of recordings. Only recordings of the folder can be opened.
    async fn play(&mut self, command: Command) -> Result<(), End> {
        let Some((library, player)) = &self.shared.player else {
            let text = "this is live; recordings are shown by softtwin view --recording FILE".into();
            return self.notify(&Notification::Refused { text }).await;
        };
        if let Command::Open(name) = &command
            && !library.names().contains(name)
        {
            let known = library.names().join(", ");
            let text = format!("expected a recording of the folder ({known}), found {name:?}");
            return self.notify(&Notification::Refused { text }).await;
        }
        player.send(command).map_err(|_| End::Gone)
    }

    /// Ends the connection to a page that sends too much.
    fn count(&mut self) -> Result<(), End> {
        if self.second.elapsed() > Duration::from_secs(1) {
            (self.second, self.messages) = (Instant::now(), 0);
        }
        self.messages += 1;
        if self.messages > MAX_MESSAGES { Err(End::Refused("too many messages a second")) } else { Ok(()) }
    }

    async fn notify(&mut self, notification: &Notification<'_>) -> Result<(), End> {
        let text = serde_json::to_string(notification).map_err(|_| End::Gone)?;
        self.send(Message::Text(text.into())).await
    }

    async fn send(&mut self, message: Message) -> Result<(), End> {
        match tokio::time::timeout(SEND_TIMEOUT, self.socket.send(message)).await {
            Ok(Ok(())) => Ok(()),
            _ => Err(End::Gone),
        }
    }
}
