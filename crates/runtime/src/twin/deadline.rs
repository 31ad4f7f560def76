//! Time without a good reading after which the state is stale.

use crate::config::ms_to_ns;

/// Shortest deadline that follows a source, ns.
pub const LEAST_NS: u64 = 100_000_000;
/// Mean intervals of a deadline.
pub const INTERVALS: f64 = 4.0;
/// Weight of a new interval in the mean.
const WEIGHT: f64 = 0.125;

/// Deadline of a source: as set, or [`INTERVALS`] mean intervals between good readings and at least [`LEAST_NS`].
#[derive(Debug, Clone, Copy)]
pub struct Deadline {
    set_ns: Option<u64>,
    /// Exponentially weighted mean, ns; 0 before the second reading.
    interval_ns: f64,
}

impl Deadline {
    /// Deadline of a source whose rate is not known yet.
    pub fn new(deadline_ms: Option<f64>) -> Self {
        Self { set_ns: deadline_ms.map(ms_to_ns), interval_ns: 0.0 }
    }

    /// Takes the interval between two good readings. A longer one than the deadline counts as the deadline: a pause is no rate.
    pub fn take(&mut self, interval_ns: u64) {
        let interval_ns = interval_ns as f64;
        let limited = interval_ns.min(INTERVALS * self.interval_ns);
        self.interval_ns = match self.interval_ns {
            0.0 => interval_ns,
            mean => mean + WEIGHT * (limited - mean),
        };
    }

    /// The deadline, ns.
    pub fn ns(&self) -> u64 {
        self.set_ns.unwrap_or_else(|| LEAST_NS.max((INTERVALS * self.interval_ns) as u64))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deadline_follows_the_rate_and_a_pause_is_no_rate() {
        let mut deadline = Deadline::new(None);
        assert_eq!(deadline.ns(), LEAST_NS);
        (0..100).for_each(|_| deadline.take(10_000_000));
        assert_eq!(deadline.ns(), LEAST_NS);
        let mut missed = 0;
        for row in 0_u64..600 {
            // 8 Hz with jitter.
            let interval_ns = 75_000_000 + row * 37_000_000 % 101_000_000;
            missed += u32::from(interval_ns > deadline.ns());
            deadline.take(interval_ns);
        }
        assert!(missed < 10 && (450_000_000..550_000_000).contains(&deadline.ns()), "{missed} {deadline:?}");
        deadline.take(60_000_000_000);
        assert!(deadline.ns() < 800_000_000, "{deadline:?}");
        let mut set = Deadline::new(Some(30.0));
        set.take(1_000_000_000);
        assert_eq!(set.ns(), 30_000_000);
    }
}
