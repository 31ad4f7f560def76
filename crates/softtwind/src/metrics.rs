//! The metrics page on a loopback port; off by default.

use anyhow::Context;
use runtime::metrics;
use runtime::thread_group::ThreadGroup;
use runtime::wire::{Bus, Domain, Health, HealthReader, Topic};
use std::net::{SocketAddr, TcpListener};

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
        Err("expected a loopback address: the page has no password; put a proxy before it to reach it from elsewhere".into())
    }
}

impl MetricsOptions {
    /// Opens the port, if there is to be one.
    ///
    /// # Errors
    /// A port in use.
    pub fn open(&self) -> anyhow::Result<Option<TcpListener>> {
        let Some(address) = self.address else { return Ok(None) };
        let listener = TcpListener::bind(address)
            .with_context(|| format!("--metrics {address}: cannot listen there; is the port in use?"))?;
        tracing::info!("metrics: http://{}/metrics", listener.local_addr()?);
        Ok(Some(listener))
    }
}

/// Serves the page in a thread, if there is a port. `page` is made in that thread, and writes the text anew for each visitor.
///
/// # Errors
/// The system refuses a thread.
pub fn serve<P: FnMut() -> String + 'static>(
    group: &mut ThreadGroup,
    listener: Option<TcpListener>,
    page: impl FnOnce() -> P + Send + 'static,
) -> std::io::Result<()> {
    let Some(listener) = listener else { return Ok(()) };
    group.start("metrics", move |end| Ok(metrics::serve(listener, end.as_atomic(), page())?))
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
            // A reader that fails keeps showing its last health, whose age grows for whoever reads the page.
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
