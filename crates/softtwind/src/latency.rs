//! Latencies and their percentiles.

use hdrhistogram::Histogram;
use serde::Serialize;

/// Largest latency that is resolved, ns: ten minutes.
const MAX_NS: u64 = 600_000_000_000;

/// A collection of latencies, to three significant digits.
#[derive(Debug)]
pub struct Latencies(Histogram<u64>);

/// Percentiles in microseconds; 0 when nothing was recorded.
#[derive(Debug, Serialize)]
pub struct PercentilesUs {
    pub p50: f64,
    pub p99: f64,
    pub max: f64,
}

impl Latencies {
    /// An empty collection.
    ///
    /// # Errors
    /// Invalid bounds of the histogram.
    pub fn new() -> anyhow::Result<Self> {
        Ok(Self(Histogram::new_with_bounds(1, MAX_NS, 3)?))
    }

    /// Adds a latency (ns).
    pub fn record_ns(&mut self, latency_ns: u64) {
        self.0.saturating_record(latency_ns);
    }

    /// True without latencies.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Median, 99th percentile and maximum (us).
    pub fn percentiles_us(&self) -> PercentilesUs {
        let us = |ns: u64| ns as f64 / 1000.0;
        PercentilesUs {
            p50: us(self.0.value_at_quantile(0.5)),
            p99: us(self.0.value_at_quantile(0.99)),
            max: us(self.0.max()),
        }
    }

    /// Removes all latencies.
    pub fn clear(&mut self) {
        self.0.reset();
    }
}

#[cfg(test)]
#[path = "../tests/unit/latency.rs"]
mod tests;
