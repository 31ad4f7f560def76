//! The metrics page: a few lines of HTTP on a loopback port, off unless asked for.

use anyhow::Context;
use runtime::metrics;
use runtime::wire::{Bus, Domain, Health, HealthReader, Topic};
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Whether and where to serve metrics.
#[derive(Debug, Clone, clap::Args)]
pub struct MetricsOptions {
    /// Serve Prometheus metrics at http://ADDR/metrics; loopback only [default: off]
    #[arg(long = "metrics", value_name = "127.0.0.1:PORT", value_parser = loopback)]
    address: Option<SocketAddr>,
}

fn loopback(text: &str) -> Result<SocketAddr, String> {
    let address: SocketAddr =
        text.parse().map_err(|_| "expected an address such as 127.0.0.1:9464".to_owned())?;
    if address.ip().is_loopback() {
        Ok(address)
    } else {
        Err("expected a loopback address: the page has no guard; put a proxy before it to reach it from elsewhere".into())
    }
}

/// How long a visitor may take to ask, and to listen.
const PATIENCE: Duration = Duration::from_millis(500);
/// How often the end of the process is looked for.
const INTERVAL: Duration = Duration::from_millis(50);
/// Longest request that is read.
const REQUEST_BYTES: usize = 4096;

impl MetricsOptions {
    /// Opens the port, if there is to be one.
    ///
    /// # Errors
    /// A port in use.
    pub fn open(&self) -> anyhow::Result<Option<TcpListener>> {
        let Some(address) = self.address else { return Ok(None) };
        let listener = TcpListener::bind(address)
            .with_context(|| format!("--metrics {address}: cannot listen there; is the port in use?"))?;
        listener.set_nonblocking(true)?;
        tracing::info!("metrics: http://{}/metrics", listener.local_addr()?);
        Ok(Some(listener))
    }
}

/// Answers one visitor after the other until `done`. `page` makes the text anew for each.
pub fn serve(listener: TcpListener, done: &AtomicBool, mut page: impl FnMut() -> String) {
    while !done.load(Ordering::Acquire) {
        match listener.accept() {
            // A visitor who hangs up is no trouble of ours.
            Ok((stream, _)) => drop(answer(stream, &mut page)),
            Err(error) if error.kind() == ErrorKind::WouldBlock => std::thread::sleep(INTERVAL),
            Err(error) => {
                tracing::warn!("metrics: {error}");
                std::thread::sleep(INTERVAL);
            }
        }
    }
}

fn answer(mut stream: TcpStream, page: &mut impl FnMut() -> String) -> std::io::Result<()> {
    stream.set_nonblocking(false)?;
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let mut request = Vec::new();
    let mut part = [0; 512];
    while !request.windows(4).any(|window| window == b"\r\n\r\n") && request.len() < REQUEST_BYTES {
        let count = stream.read(&mut part)?;
        if count == 0 {
            break;
        }
        request.extend_from_slice(part.get(..count).unwrap_or_default());
    }
    let (status, body) = if request.starts_with(b"GET /metrics ") {
        ("200 OK", page())
    } else {
        ("404 Not Found", "the metrics are at /metrics\n".to_owned())
    };
    write!(
        stream,
        "HTTP/1.1 {status}\r\nContent-Type: text/plain; version=0.0.4\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{body}",
        body.len()
    )
}

/// The page of the twins: an ordinary reader of their health topics, so that the loop knows nothing of it.
pub fn twins(domain: &Domain, names: &[String]) -> impl FnMut() -> String + use<> {
    let readers = readers(domain, names);
    if let Err(error) = &readers {
        tracing::warn!("metrics: no health to show: {error:#}");
    }
    let mut readers = readers.unwrap_or_default();
    move || {
        for (reader, last) in &mut readers {
            // A reader that fails keeps showing its last health, whose age grows on the page of whoever scrapes it.
            *last = reader.newest().ok().flatten().or(*last);
        }
        let known: Vec<Health> = readers.iter().filter_map(|(_, last)| *last).collect();
        metrics::twins(&known)
    }
}

fn readers(domain: &Domain, names: &[String]) -> anyhow::Result<Vec<(HealthReader, Option<Health>)>> {
    let bus = Bus::open(domain)?;
    names.iter().map(|name| Ok((HealthReader::attach(&bus, &Topic::health(name)?)?, None))).collect()
}
