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
#[path = "../tests/unit/gaps.rs"]
mod tests;
