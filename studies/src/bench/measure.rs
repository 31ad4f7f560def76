//! Timing and quantiles.

use hdrhistogram::Histogram;
use serde::Serialize;
use std::hint::black_box;
use std::time::Instant;

/// Durations of one thing, to a thousandth of their value.
#[derive(Debug)]
pub struct Durations {
    /// Name.
    pub name: String,
    ns: Histogram<u64>,
}

/// Longest duration that is told apart from longer ones: a minute.
const MAX_NS: u64 = 60_000_000_000;
/// Steps of a curve between a fraction of samples and half of it.
const STEPS: u32 = 20;

/// Quantiles in microseconds.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Quantiles {
    /// Median.
    pub p50: f64,
    /// 99 of 100 are faster.
    pub p99: f64,
    /// 999 of 1000 are faster.
    pub p999: f64,
    /// The slowest.
    pub max: f64,
}

impl Durations {
    /// An empty series.
    ///
    /// # Panics
    /// Never: the bounds are fixed and valid.
    pub fn new(name: impl Into<String>) -> Self {
        let ns = Histogram::new_with_bounds(1, MAX_NS, 3).expect("fixed bounds");
        Self { name: name.into(), ns }
    }

    /// Runs `work` once on the clock.
    pub fn time<T>(&mut self, work: impl FnOnce() -> T) {
        let start = Instant::now();
        black_box(work());
        self.push(u64::try_from(start.elapsed().as_nanos()).unwrap_or(u64::MAX));
    }

    /// Adds a duration measured elsewhere.
    pub fn push(&mut self, ns: u64) {
        self.ns.saturating_record(ns);
    }

    /// Samples so far.
    pub fn len(&self) -> u64 {
        self.ns.len()
    }

    /// Whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.ns.is_empty()
    }

    /// Times in microseconds and the fraction of slower samples; for the slowest sample that of one sample.
    pub fn tail(&self) -> Vec<(f64, f64)> {
        let one = 1.0 / self.len() as f64;
        let quantiles = self.ns.iter_quantiles(STEPS);
        quantiles
            .map(|q| (q.value_iterated_to() as f64 / 1e3, (1.0 - q.quantile_iterated_to()).max(one)))
            .collect()
    }

    /// Quantiles; NaN when nothing was measured.
    pub fn quantiles(&self) -> Quantiles {
        let at = |quantile: f64| match self.is_empty() {
            true => f64::NAN,
            false => self.ns.value_at_quantile(quantile) as f64 / 1e3,
        };
        Quantiles { p50: at(0.5), p99: at(0.99), p999: at(0.999), max: at(1.0) }
    }

    /// Median, microseconds.
    pub fn p50(&self) -> f64 {
        self.quantiles().p50
    }
}

/// `bytes` in `us` as 1e9 bytes a second.
pub fn gbps(bytes: usize, us: f64) -> f64 {
    bytes as f64 / us / 1e3
}

/// Pushes everything else out of the caches by walking through more memory than they hold.
pub struct Evictor {
    memory: Vec<u8>,
}

/// Three times the largest last-level cache of one socket's quadrant that we know of.
const EVICT_BYTES: usize = 96 << 20;
const LINE: usize = 64;

impl Default for Evictor {
    /// Takes the memory.
    fn default() -> Self {
        Self { memory: vec![1; EVICT_BYTES] }
    }
}

impl Evictor {
    /// Writes to every cache line of it.
    pub fn evict(&mut self) {
        for byte in self.memory.iter_mut().step_by(LINE) {
            *byte = byte.wrapping_add(1);
        }
        black_box(&self.memory);
    }
}

#[cfg(test)]
#[path = "../../tests/unit/bench_measure.rs"]
mod tests;
