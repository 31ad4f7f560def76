//! The metrics endpoint on a loopback port; off by default.

use runtime::metrics;
use runtime::wire::{Bus, Domain, Estimate, EstimateReader, Health, HealthReader, Topic};
use std::net::{SocketAddr, TcpListener};

/// Address of the metrics endpoint.
#[derive(Debug, Clone, clap::Args)]
pub struct MetricsOptions {
    /// Serve Prometheus metrics at http://ADDR/metrics; loopback only [default: off]
    #[arg(long = "metrics", value_name = "127.0.0.1:PORT", value_parser = metrics::loopback)]
    address: Option<SocketAddr>,
}

impl MetricsOptions {
    /// Opens the port, if there is to be one.
    ///
    /// # Errors
    /// A port in use.
    pub fn open(&self) -> std::io::Result<Option<TcpListener>> {
        metrics::listen(self.address)
    }
}

/// Metrics of the twins, read from their topics. `names`: each actuator and whether it has estimates.
pub fn twins(domain: &Domain, names: &[(String, bool)]) -> impl FnMut() -> String + use<> {
    let readers = readers(domain, names);
    if let Err(error) = &readers {
        tracing::warn!("metrics: no health to show: {error:#}");
    }
    let (mut healths, mut estimates) = readers.unwrap_or_default();
    move || {
        // After a failure the last health stays; its age grows.
        healths.iter_mut().for_each(|(reader, last)| *last = reader.newest().ok().flatten().or(*last));
        estimates.iter_mut().for_each(|(reader, last)| *last = reader.newest().ok().flatten().or(*last));
        let known: Vec<Health> = healths.iter().filter_map(|(_, last)| *last).collect();
        let estimated: Vec<Estimate> = estimates.iter().filter_map(|(_, last)| *last).collect();
        metrics::twins(&known, &estimated)
    }
}

/// Readers with their last samples.
type Last<R, S> = Vec<(R, Option<S>)>;

fn readers(
    domain: &Domain,
    names: &[(String, bool)],
) -> anyhow::Result<(Last<HealthReader, Health>, Last<EstimateReader, Estimate>)> {
    let bus = Bus::open(domain)?;
    let (mut healths, mut estimates) = (Vec::new(), Vec::new());
    for (name, has_estimates) in names {
        healths.push((HealthReader::attach(&bus, &Topic::health(name)?)?, None));
        if *has_estimates {
            estimates.push((EstimateReader::attach(&bus, &Topic::estimate(name)?)?, None));
        }
    }
    Ok((healths, estimates))
}
