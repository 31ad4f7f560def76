//! Lost samples.

use wire::Stamp;

/// Finds lost samples by jumps of the sequence number. A new run of the sender starts a new count.
#[derive(Debug, Default)]
pub struct SequenceTracker {
    last: Option<(u64, u64)>,
    lost: u64,
}

impl SequenceTracker {
    /// Records a received sample.
    pub fn record(&mut self, stamp: &Stamp) {
        if let Some((boot_id, seq)) = self.last
            && boot_id == stamp.boot_id
        {
            self.lost += stamp.seq.saturating_sub(seq + 1);
        }
        self.last = Some((stamp.boot_id, stamp.seq));
    }

    /// Samples lost since the last call.
    pub fn take_lost(&mut self) -> u64 {
        std::mem::take(&mut self.lost)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jumps_are_lost_samples_and_restarts_are_not() {
        let mut tracker = SequenceTracker::default();
        for (boot_id, seq) in [(1, 5), (1, 6), (1, 9), (2, 1), (2, 2), (2, 4)] {
            tracker.record(&Stamp { boot_id, seq, t_sensor_ns: 0, t_publish_ns: 0 });
        }
        assert_eq!((tracker.take_lost(), tracker.take_lost()), (3, 0));
    }
}
