//! Latencies and their percentiles.

use hdrhistogram::Histogram;
use serde::Serialize;

/// The largest latency that is told apart from larger ones: ten minutes.
const MAX_NS: u64 = 600_000_000_000;

/// A collection of latencies, to three significant digits.
#[derive(Debug)]
pub struct Latencies(Histogram<u64>);

/// Percentiles in microseconds; 0 when nothing was recorded.
#[derive(Debug, Serialize)]
#[allow(missing_docs)] // each is named like the percentile
pub struct PercentilesUs {
    pub p50: f64,
    pub p99: f64,
    pub max: f64,
}

impl Latencies {
    /// An empty collection.
    ///
    /// # Errors
    /// Bounds that the histogram does not allow; those here are allowed.
    pub fn new() -> anyhow::Result<Self> {
        Ok(Self(Histogram::new_with_bounds(1, MAX_NS, 3)?))
    }

    /// Adds a latency (ns).
    pub fn record_ns(&mut self, latency_ns: u64) {
        self.0.saturating_record(latency_ns);
    }

    /// Whether nothing was recorded.
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
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_ordered_and_the_maximum_is_the_largest_value() {
        let mut latencies = Latencies::new().expect("allowed bounds");
        assert!(latencies.is_empty() && latencies.percentiles_us().max == 0.0);
        (1..=1000).for_each(|k| latencies.record_ns(1000 * k));
        let PercentilesUs { p50, p99, max } = latencies.percentiles_us();
        assert!((p50 - 500.0).abs() < 1.0 && (p99 - 990.0).abs() < 2.0 && (max - 1000.0).abs() < 1.0);
        latencies.record_ns(u64::MAX);
        assert!(latencies.percentiles_us().max >= MAX_NS as f64 / 1000.0, "saturated, not lost");
    }
}
