//! Latencies and their percentiles.

use hdrhistogram::Histogram;
use runtime::latency::histogram;
use serde::Serialize;

/// A collection of latencies; percentiles are at most 1 % too high.
#[derive(Debug)]
pub struct Latencies(Histogram<u32>);

/// Percentiles in microseconds; 0 when nothing was recorded.
#[derive(Debug, Serialize)]
pub struct PercentilesUs {
    pub p50: f64,
    pub p99: f64,
    pub max: f64,
}

impl Latencies {
    /// An empty collection.
    #[expect(clippy::new_without_default, reason = "made in one way")]
    pub fn new() -> Self {
        Self(histogram())
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
