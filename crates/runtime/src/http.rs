//! HTTP server for this machine: bounded in time and in connections, so that idle clients do not block others.

use axum::body::Body;
use hyper::body::Incoming;
use hyper::server::conn::http1::Builder;
use hyper::service::{Service, service_fn};
use hyper::{Request, Response};
use hyper_util::rt::{TokioIo, TokioTimer};
use std::cell::Cell;
use std::error::Error;
use std::net::IpAddr;
use std::rc::Rc;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::task::{JoinHandle, LocalSet, spawn_local, yield_now};
use tokio::time::{Instant, sleep};

/// Time after which a client without a complete request head is disconnected.
pub const HEADER_TIMEOUT: Duration = Duration::from_secs(2);
/// Connections at a time. One more takes the place of the oldest one that has asked for nothing yet.
pub const MAX_CONNECTIONS: usize = 64;
/// Largest head of a request, bytes; a longer one is refused with status 431.
const MAX_HEAD: usize = 16 * 1024;
/// Pause before the next try when the system refuses a connection, or no place is free.
const RETRY: Duration = Duration::from_millis(20);
/// Smallest interval between logged I/O errors.
const LOG_EVERY: Duration = Duration::from_secs(10);

struct Connection {
    since: Instant,
    /// Whether the head of a request has come.
    has_asked: Rc<Cell<bool>>,
    task: JoinHandle<()>,
}

/// All clients, in the order of connection.
#[derive(Default)]
struct Connections(Vec<Connection>);

/// Serves until `stop` is done. Everything runs in the calling thread, so that `service` may hold what belongs to it.
pub async fn serve<S>(listener: TcpListener, service: S, stop: impl Future<Output = ()>)
where
    S: Service<Request<Incoming>, Response = Response<Body>> + Clone + 'static,
    S::Error: Into<Box<dyn Error + Send + Sync>>,
{
    let accept = async {
        let mut connections = Connections::default();
        let mut next_log = Instant::now();
        loop {
            match listener.accept().await {
                Ok((stream, _)) => {
                    connections.make_room().await;
                    connections.0.push(connect(stream, service.clone()));
                    // Reads what has come before the next connection is taken: a request that came along with its
                    // connection is answered, however many idle connections follow.
                    yield_now().await;
                }
                Err(error) => {
                    if Instant::now() >= next_log {
                        next_log = Instant::now() + LOG_EVERY;
                        tracing::warn!("http: connections cannot be accepted: {error}; {}", cure(&error));
                    }
                    sleep(RETRY).await;
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

/// Remedy for an I/O error.
fn cure(error: &std::io::Error) -> &'static str {
    match error.raw_os_error() {
        Some(libc::EMFILE) => "raise the limit of open files of this program (LimitNOFILE, ulimit -n)",
        Some(libc::ENFILE) => "raise the limit of open files of this machine (fs.file-max)",
        _ => "trying again",
    }
}

fn connect<S>(stream: TcpStream, service: S) -> Connection
where
    S: Service<Request<Incoming>, Response = Response<Body>> + 'static,
    S::Error: Into<Box<dyn Error + Send + Sync>>,
{
    let has_asked = Rc::new(Cell::new(false));
    let asked = has_asked.clone();
    let noted = service_fn(move |request| {
        asked.set(true);
        service.call(request)
    });
    let connection = Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEADER_TIMEOUT)
        .max_buf_size(MAX_HEAD)
        .serve_connection(TokioIo::new(stream), noted)
        .with_upgrades();
    let task = spawn_local(async move {
        let _visitors_may_leave_at_any_time = connection.await;
    });
    Connection { since: Instant::now(), has_asked, task }
}

impl Connections {
    /// Waits until there is a place: closes the oldest connection that has asked for nothing, or else the oldest one that
    /// has taken longer than [`HEADER_TIMEOUT`].
    async fn make_room(&mut self) {
        loop {
            self.0.retain(|connection| !connection.task.is_finished());
            if self.0.len() < MAX_CONNECTIONS {
                return;
            }
            let idle = self.0.iter().position(|connection| !connection.has_asked.get());
            let slow = || self.0.iter().position(|connection| connection.since.elapsed() > HEADER_TIMEOUT);
            match idle.or_else(slow) {
                Some(at) => self.0.remove(at).task.abort(),
                None => sleep(RETRY).await,
            }
        }
    }
}

/// True if a `Host` header names this machine. Any site in a browser can send requests here under its own name; foreign names
/// are refused.
pub fn is_this_machine(host: &str) -> bool {
    let name = host
        .rsplit_once(':')
        .filter(|(_, port)| port.bytes().all(|byte| byte.is_ascii_digit()))
        .map_or(host, |(name, _)| name);
    matches!(name, "localhost" | "[::1]") || name.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}
