//! A small HTTP server for pages on this machine: bounded in time and in connections, so that idle visitors block nobody.

use axum::body::Body;
use hyper::body::Incoming;
use hyper::server::conn::http1::Builder;
use hyper::service::HttpService;
use hyper_util::rt::{TokioIo, TokioTimer};
use std::error::Error;
use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::Semaphore;
use tokio::task::{LocalSet, spawn_local};

/// A visitor who has not sent the head of a request for so long is disconnected.
pub const HEADER_TIMEOUT: Duration = Duration::from_secs(2);
/// Connections at a time; more wait until one ends.
pub const MAX_CONNECTIONS: usize = 64;
/// Largest head of a request, bytes; a longer one is refused with status 431.
const MAX_HEAD: usize = 16 * 1024;

/// Serves until `stop` is done. Everything runs in the calling thread, so that `service` may hold what belongs to it.
pub async fn serve<S>(listener: TcpListener, service: S, stop: impl Future<Output = ()>)
where
    S: HttpService<Incoming, ResBody = Body> + Clone + 'static,
    S::Error: Into<Box<dyn Error + Send + Sync>>,
{
    let places = Arc::new(Semaphore::new(MAX_CONNECTIONS));
    let accept = async {
        loop {
            let place = places.clone().acquire_owned().await;
            match listener.accept().await {
                Ok((stream, _)) => {
                    let connection = Builder::new()
                        .timer(TokioTimer::new())
                        .header_read_timeout(HEADER_TIMEOUT)
                        .max_buf_size(MAX_HEAD)
                        .serve_connection(TokioIo::new(stream), service.clone())
                        .with_upgrades();
                    spawn_local(async move {
                        let _visitors_may_leave_at_any_time = connection.await;
                        drop(place);
                    });
                }
                // No file descriptor is free, say.
                Err(error) => {
                    tracing::warn!("http: cannot accept a connection: {error}");
                    tokio::time::sleep(Duration::from_millis(100)).await;
                }
            }
        }
    };
    let serving = async {
        tokio::select! {
            () = stop => (),
            () = accept => (),
        }
    };
    LocalSet::new().run_until(serving).await;
}

/// Whether a `Host` header names this machine. Any page in a browser can send requests here under a name of its own; one with
/// a foreign name is refused.
pub fn is_this_machine(host: &str) -> bool {
    let name = host
        .rsplit_once(':')
        .filter(|(_, port)| port.bytes().all(|byte| byte.is_ascii_digit()))
        .map_or(host, |(name, _)| name);
    matches!(name, "localhost" | "[::1]") || name.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}
