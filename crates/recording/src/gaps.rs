//! Finds what is missing in a numbered stream.

use wire::Stamp;

/// Samples that were published and never arrived.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Gap {
    /// The number that was expected.
    pub expected_seq: u64,
    /// The number that came.
    pub found_seq: u64,
}

impl Gap {
    /// How many are missing.
    pub fn missing(self) -> u64 {
        self.found_seq.saturating_sub(self.expected_seq)
    }
}

/// Follows the sequence numbers of one topic. A new publisher (another boot id) starts its own count.
#[derive(Debug, Default)]
pub struct GapCounter {
    last: Option<(u64, u64)>,
}

impl GapCounter {
    /// Notes a sample; returns the gap in front of it, if there is one.
    pub fn observe(&mut self, stamp: Stamp) -> Option<Gap> {
        let (boot_id, last_seq) = self.last.replace((stamp.boot_id, stamp.seq))?;
        let gap = Gap { expected_seq: last_seq.saturating_add(1), found_seq: stamp.seq };
        (boot_id == stamp.boot_id && gap.missing() > 0).then_some(gap)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_jump_is_a_gap_and_a_new_publisher_is_not() {
        let mut gaps = GapCounter::default();
        let mut observe =
            |boot_id, seq| gaps.observe(Stamp { boot_id, seq, t_sensor_ns: 0, t_publish_ns: 0 });
        assert_eq!(observe(1, 10), None, "the first sample starts the count");
        assert_eq!(observe(1, 11), None);
        assert_eq!(observe(1, 15), Some(Gap { expected_seq: 12, found_seq: 15 }));
        assert_eq!(observe(2, 900), None, "another boot id is another publisher");
        assert_eq!(observe(2, 899), None, "backwards is not a loss");
        assert_eq!(
            observe(2, 902),
            Some(Gap { expected_seq: 900, found_seq: 902 }),
            "two were lost after 899"
        );
        assert_eq!(observe(2, u64::MAX).map(Gap::missing), Some(u64::MAX - 903));
        assert_eq!(observe(2, u64::MAX), None);
    }
}
