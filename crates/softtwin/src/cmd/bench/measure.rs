//! Timing and quantiles.

use serde::Serialize;
use std::hint::black_box;
use std::time::Instant;

/// Durations of one thing, ns.
#[derive(Debug, Clone, Default)]
pub struct Series {
    /// What was timed.
    pub name: String,
    ns: Vec<u64>,
}

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

impl Series {
    /// An empty series with room for `samples`.
    pub fn new(name: impl Into<String>, samples: usize) -> Self {
        Self { name: name.into(), ns: Vec::with_capacity(samples) }
    }

    /// Runs `work` once on the clock.
    pub fn time<T>(&mut self, work: impl FnOnce() -> T) {
        let start = Instant::now();
        black_box(work());
        self.push(u64::try_from(start.elapsed().as_nanos()).unwrap_or(u64::MAX));
    }

    /// Adds a duration measured elsewhere.
    pub fn push(&mut self, ns: u64) {
        self.ns.push(ns);
    }

    /// Samples so far.
    pub fn len(&self) -> usize {
        self.ns.len()
    }

    /// All samples in microseconds, the fastest first.
    pub fn sorted_us(&self) -> Vec<f64> {
        let mut ns = self.ns.clone();
        ns.sort_unstable();
        ns.into_iter().map(|ns| ns as f64 / 1e3).collect()
    }

    /// Quantiles by the nearest rank; NaN when nothing was measured.
    pub fn quantiles(&self) -> Quantiles {
        let sorted = self.sorted_us();
        let at = |share: f64| {
            let rank = (share * sorted.len() as f64).ceil() as usize;
            sorted.get(rank.saturating_sub(1)).copied().unwrap_or(f64::NAN)
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

impl Evictor {
    /// Takes the memory.
    pub fn new() -> Self {
        Self { memory: vec![1; EVICT_BYTES] }
    }

    /// Writes to every cache line of it.
    pub fn evict(&mut self) {
        for byte in self.memory.iter_mut().step_by(LINE) {
            *byte = byte.wrapping_add(1);
        }
        black_box(&self.memory);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_nearest_ranks() {
        let mut series = Series::new("x", 1000);
        (1..=1000u64).rev().for_each(|us| series.push(us * 1000));
        let q = series.quantiles();
        assert_eq!((q.p50, q.p99, q.p999, q.max), (500.0, 990.0, 999.0, 1000.0));
        let mut one = Series::new("x", 1);
        one.push(7_000);
        assert_eq!((one.p50(), one.quantiles().max), (7.0, 7.0));
        assert!(Series::new("x", 0).p50().is_nan());
    }

    #[test]
    fn bandwidth_is_bytes_over_time() {
        assert_eq!(gbps(3_000_000, 30.0), 100.0);
    }
}
