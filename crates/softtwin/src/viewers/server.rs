//! The Foxglove app's websocket protocol: the server names its channels, a client subscribes to some and gets their messages.
//!
//! Texts are JSON objects with `op`. A message is binary: 1, then the client's number of the subscription (`u32`), the time
//! (`u64`, ns), the message; numbers are little-endian.

use anyhow::{Context, Result};
use axum::Router;
use axum::body::Bytes;
use axum::extract::State;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::any;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use hyper_util::service::TowerToHyperService;
use recording::{Channel, Schema};
use serde::Deserialize;
use serde_json::json;
use std::collections::HashMap;
use std::net::{IpAddr, SocketAddr};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::broadcast;

/// Names of the protocol, newest first.
const PROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];
/// Clients at the same time.
const MAX_CLIENTS: usize = 16;
/// Messages that wait for a slow client; of more the oldest are left out.
const BACKLOG: usize = 64;
/// A client that does not take a message for so long is gone.
const SEND_TIMEOUT: Duration = Duration::from_secs(10);
/// Largest text of a client, bytes.
const MAX_MESSAGE: usize = 64 * 1024;
const MESSAGE: u8 = 1;

/// The end that is filled.
#[derive(Clone)]
pub struct Sender(Arc<Shared>);

/// A port that clients connect to.
pub struct Server {
    listener: TcpListener,
    shared: Arc<Shared>,
}

struct Shared {
    channels: Mutex<Vec<Arc<Channel>>>,
    events: broadcast::Sender<Event>,
    /// Pages of other sites that may connect.
    origins: Vec<String>,
}

/// What happens to all clients. A channel's number is its place.
#[derive(Clone)]
enum Event {
    Channel(usize),
    Message { channel: usize, time_ns: u64, data: Bytes },
}

/// What a client may send.
#[derive(Deserialize)]
#[serde(tag = "op", rename_all = "camelCase")]
enum Request {
    Subscribe {
        subscriptions: Vec<Subscription>,
    },
    #[serde(rename_all = "camelCase")]
    Unsubscribe {
        subscription_ids: Vec<u32>,
    },
    #[serde(other)]
    Other,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Subscription {
    id: u32,
    channel_id: usize,
}

impl Sender {
    /// Whether anybody looks.
    pub fn is_watched(&self) -> bool {
        self.0.events.receiver_count() > 0
    }

    /// Sends a message to the clients that want its channel, which is announced at its first message.
    pub fn send(&self, channel: &Arc<Channel>, time_ns: u64, data: Vec<u8>) {
        let mut channels = self.0.channels.lock().unwrap_or_else(PoisonError::into_inner);
        let known = channels.iter().position(|known| known.topic == channel.topic);
        let number = known.unwrap_or(channels.len());
        // Without clients there is nobody to take an event.
        if known.is_none() {
            channels.push(channel.clone());
            let _ = self.0.events.send(Event::Channel(number));
        }
        drop(channels);
        let _ = self.0.events.send(Event::Message { channel: number, time_ns, data: data.into() });
    }
}

impl Server {
    /// Binds the port. Pages of `origins` may connect, and those of this machine.
    ///
    /// # Errors
    /// When the port is in use or not allowed.
    pub async fn bind(address: IpAddr, port: u16, origins: Vec<String>) -> Result<Self> {
        let listener = TcpListener::bind(SocketAddr::new(address, port)).await.with_context(|| {
            format!(
                "cannot listen on {address} port {port}; --port N takes another port, --port 0 any free one"
            )
        })?;
        let shared = Shared { channels: Mutex::default(), events: broadcast::Sender::new(BACKLOG), origins };
        Ok(Self { listener, shared: Arc::new(shared) })
    }

    /// The end that is filled.
    pub fn sender(&self) -> Sender {
        Sender(self.shared.clone())
    }

    /// The address for the app.
    ///
    /// # Errors
    /// When the system does not tell it.
    pub fn url(&self) -> Result<String> {
        Ok(format!("ws://{}", self.listener.local_addr().context("the port has no address")?))
    }

    /// Serves until `stop` is done.
    pub async fn run(self, stop: impl Future<Output = ()>) {
        let router = Router::new().route("/", any(connect)).with_state(self.shared);
        runtime::http::serve(self.listener, TowerToHyperService::new(router), stop).await;
    }
}

async fn connect(
    State(shared): State<Arc<Shared>>,
    headers: HeaderMap,
    upgrade: WebSocketUpgrade,
) -> Response {
    let refuse =
        |text: String| (StatusCode::FORBIDDEN, format!("softtwin foxglove: {text}\n")).into_response();
    if let Some(origin) = headers.get(header::ORIGIN).and_then(|origin| origin.to_str().ok())
        && !is_allowed(origin, &shared.origins)
    {
        return refuse(format!(
            "expected a page of {}, found {origin}; --origin adds one",
            shared.origins.join(", ")
        ));
    }
    if shared.events.receiver_count() >= MAX_CLIENTS {
        return refuse(format!("expected at most {MAX_CLIENTS} clients; close one"));
    }
    upgrade.protocols(PROTOCOLS).max_message_size(MAX_MESSAGE).on_upgrade(move |socket| async move {
        // A client that is gone is no error.
        let _ = serve(socket, &shared).await;
    })
}

/// Desktop apps send `file://` or nothing.
fn is_allowed(origin: &str, origins: &[String]) -> bool {
    let host = origin.split_once("://").map_or("", |(_, host)| host);
    origin == "file://" || runtime::http::is_this_machine(host) || origins.iter().any(|known| known == origin)
}

async fn serve(mut socket: WebSocket, shared: &Shared) -> Result<()> {
    let mut events = shared.events.subscribe();
    let hello = json!({"op": "serverInfo", "name": "softtwin", "capabilities": [], "supportedEncodings": [], "metadata": {}});
    send(&mut socket, Message::Text(hello.to_string().into())).await?;
    let known = shared.channels.lock().unwrap_or_else(PoisonError::into_inner).len();
    for number in 0..known {
        advertise(&mut socket, shared, number).await?;
    }
    let mut subscriptions: HashMap<u32, usize> = HashMap::new();
    loop {
        tokio::select! {
            message = socket.recv() => match message.context("closed")?? {
                Message::Text(text) => match serde_json::from_str(&text).context("expected a request with op")? {
                    Request::Subscribe { subscriptions: asked } => {
                        subscriptions.extend(asked.into_iter().take(BACKLOG).map(|asked| (asked.id, asked.channel_id)));
                    }
                    Request::Unsubscribe { subscription_ids } => subscriptions.retain(|id, _| !subscription_ids.contains(id)),
                    Request::Other => {}
                },
                Message::Close(_) => return Ok(()),
                _ => {}
            },
            event = events.recv() => match event {
                Ok(Event::Channel(number)) if number >= known => advertise(&mut socket, shared, number).await?,
                Ok(Event::Message { channel, time_ns, data }) => {
                    for (id, _) in subscriptions.iter().filter(|(_, wanted)| **wanted == channel) {
                        let mut bytes = Vec::with_capacity(13 + data.len());
                        bytes.push(MESSAGE);
                        bytes.extend(id.to_le_bytes());
                        bytes.extend(time_ns.to_le_bytes());
                        bytes.extend(&data);
                        send(&mut socket, Message::Binary(bytes.into())).await?;
                    }
                }
                Ok(Event::Channel(_)) | Err(broadcast::error::RecvError::Lagged(_)) => {}
                Err(broadcast::error::RecvError::Closed) => return Ok(()),
            },
        }
    }
}

async fn advertise(socket: &mut WebSocket, shared: &Shared, number: usize) -> Result<()> {
    let channel = shared.channels.lock().unwrap_or_else(PoisonError::into_inner).get(number).cloned();
    let channel = channel.context("a channel that was announced")?;
    let (encoding, schema) = match &channel.schema {
        Schema::Json(text) => ("json", text.clone()),
        Schema::Protobuf(bytes) => ("protobuf", STANDARD.encode(bytes)),
    };
    let schema_encoding = if encoding == "json" { "jsonschema" } else { encoding };
    let told = json!({
        "id": number, "topic": channel.topic, "encoding": encoding, "schemaName": channel.schema_name,
        "schema": schema, "schemaEncoding": schema_encoding,
    });
    send(socket, Message::Text(json!({"op": "advertise", "channels": [told]}).to_string().into())).await
}

async fn send(socket: &mut WebSocket, message: Message) -> Result<()> {
    tokio::time::timeout(SEND_TIMEOUT, socket.send(message)).await.context("too slow")??;
    Ok(())
}
