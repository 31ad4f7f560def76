//! The web server: one page, its parts, one websocket.

use crate::client::{self, Shared};
use crate::guard::Guard;
use crate::pictures;
use anyhow::{Context, Result};
use axum::Router;
use axum::extract::{Request, State, WebSocketUpgrade};
use axum::http::{HeaderValue, StatusCode, header};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::{any, get};
use hyper_util::service::TowerToHyperService;
use picture::colour::{ColourMap, ENTRIES};
use std::net::{IpAddr, SocketAddr};
use std::sync::{Arc, LazyLock};
use tokio::net::TcpListener;

/// Largest message a page may send, bytes.
const MAX_MESSAGE: usize = 4096;
/// The browser loads nothing from other sites and runs no inline scripts.
const POLICY: &str = "default-src 'self'; img-src 'self' data:; style-src 'self' 'unsafe-inline'; connect-src 'self'; frame-ancestors 'none'";

/// The parts of the browser: path, type, content.
pub(crate) const PARTS: &[(&str, &str, &str)] = &[
    ("/", "text/html; charset=utf-8", include_str!("assets/index.html")),
    ("/app.css", "text/css; charset=utf-8", include_str!("assets/app.css")),
    ("/main.js", SCRIPT, include_str!("assets/main.js")),
    ("/actuator.js", SCRIPT, include_str!("assets/actuator.js")),
    ("/camera.js", SCRIPT, include_str!("assets/camera.js")),
    ("/charts.js", SCRIPT, include_str!("assets/charts.js")),
    ("/computed.js", SCRIPT, include_str!("assets/computed.js")),
    ("/gl.js", SCRIPT, include_str!("assets/gl.js")),
    ("/history.js", SCRIPT, include_str!("assets/history.js")),
    ("/link.js", SCRIPT, include_str!("assets/link.js")),
    ("/mesh.js", SCRIPT, include_str!("assets/mesh.js")),
    ("/numbers.js", SCRIPT, include_str!("assets/numbers.js")),
    ("/picture.js", SCRIPT, include_str!("assets/picture.js")),
    ("/recording.js", SCRIPT, include_str!("assets/recording.js")),
    ("/scale.js", SCRIPT, include_str!("assets/scale.js")),
    ("/scene.js", SCRIPT, include_str!("assets/scene.js")),
    ("/shaders.js", SCRIPT, include_str!("assets/shaders.js")),
    ("/solid.js", SCRIPT, include_str!("assets/solid.js")),
    ("/whatif.js", SCRIPT, include_str!("assets/whatif.js")),
];
pub(crate) const SCRIPT: &str = "text/javascript; charset=utf-8";

/// A server about to run.
pub struct Server {
    /// The bound port.
    pub listener: TcpListener,
    /// Who may look.
    pub guard: Guard,
    /// Content for browsers.
    pub shared: Shared,
}

/// Binds the port.
///
/// # Errors
/// When it is in use, not allowed, or not an address of this machine; the text says what to do.
pub async fn open_port(address: IpAddr, port: u16) -> Result<TcpListener> {
    TcpListener::bind(SocketAddr::new(address, port)).await.with_context(|| {
        format!("cannot listen on {address} port {port}; is a viewer running already? --port N takes another, --port 0 any free one")
    })
}

impl Server {
    /// The address to open, with the token if one is needed.
    pub fn url(&self) -> Result<String> {
        let address = self.listener.local_addr().context("the port has no address")?;
        let token = self.guard.token().map(|token| format!("?token={token}")).unwrap_or_default();
        Ok(format!("http://{address}/{token}"))
    }

    /// Serves until `stop` is done. Pages never close their websockets, so the end does not wait for them.
    pub async fn run(self, stop: impl Future<Output = ()>) {
        let mut router = Router::new().route("/ws", any(websocket)).route("/colours", get(colours));
        for (path, kind, content) in PARTS {
            router =
                router.route(path, get(move || async move { ([(header::CONTENT_TYPE, *kind)], *content) }));
        }
        router = pictures::routes(router, &self.shared.pictures);
        let router =
            router.with_state(self.shared).layer(from_fn_with_state(Arc::new(self.guard), check_request));
        runtime::http::serve(self.listener, TowerToHyperService::new(router), stop).await;
    }
}

/// Admits or refuses a request, and adds the headers to every response.
async fn check_request(State(guard): State<Arc<Guard>>, request: Request, next: Next) -> Response {
    if let Err(text) = guard.check(request.uri(), request.headers()) {
        return (StatusCode::FORBIDDEN, format!("softtwin view: {text}\n")).into_response();
    }
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY));
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(header::REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    if let Some(cookie) = guard.cookie().and_then(|cookie| HeaderValue::from_str(&cookie).ok()) {
        headers.insert(header::SET_COOKIE, cookie);
    }
    response
}

/// The colour table as RGB bytes: the page uses the same colours as the pictures.
pub(crate) static COLOURS: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let map = ColourMap::stress();
    (0..ENTRIES).flat_map(|k| map.srgb(k as f32 / (ENTRIES - 1) as f32)).collect()
});

async fn colours() -> impl IntoResponse {
    ([(header::CONTENT_TYPE, "application/octet-stream")], COLOURS.as_slice())
}

async fn websocket(State(shared): State<Shared>, upgrade: WebSocketUpgrade) -> Response {
    upgrade
        .max_message_size(MAX_MESSAGE)
        .max_frame_size(MAX_MESSAGE)
        .on_upgrade(move |socket| async move { client::serve(socket, &shared).await })
}

#[cfg(test)]
#[path = "../tests/unit/server.rs"]
mod tests;
