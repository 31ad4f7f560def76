//! Finds what is missing in a numbered stream.

use std::collections::HashMap;

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

/// Follows the sequence numbers of every topic. A new publisher (another boot id) starts its own count.
#[derive(Debug, Default)]
pub struct GapCounter {
    last: HashMap<String, (u64, u64)>,
    missing: u64,
}

impl GapCounter {
    /// Notes a sample; returns the gap in front of it, if there is one.
    pub fn observe(&mut self, topic: &str, boot_id: u64, seq: u64) -> Option<Gap> {
        let previous = match self.last.get_mut(topic) {
            Some(last) => std::mem::replace(last, (boot_id, seq)),
            None => {
                self.last.insert(topic.to_owned(), (boot_id, seq));
                return None;
            }
        };
        let expected_seq = previous.1.wrapping_add(1);
        if previous.0 != boot_id || seq <= expected_seq {
            return None;
        }
        let gap = Gap { expected_seq, found_seq: seq };
        self.missing = self.missing.saturating_add(gap.missing());
        Some(gap)
    }

    /// Begins anew with a topic that was not followed for a while.
    pub fn forget(&mut self, topic: &str) {
        self.last.remove(topic);
    }

    /// Samples missing over all topics so far.
    pub fn missing(&self) -> u64 {
        self.missing
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_jump_is_a_gap_and_a_new_publisher_is_not() {
        let mut gaps = GapCounter::default();
        assert_eq!(gaps.observe("a", 1, 10), None, "the first sample starts the count");
        assert_eq!(gaps.observe("a", 1, 11), None);
        assert_eq!(gaps.observe("b", 1, 0), None, "topics count apart");
        assert_eq!(gaps.observe("a", 1, 15), Some(Gap { expected_seq: 12, found_seq: 15 }));
        assert_eq!(gaps.observe("a", 2, 900), None, "another boot id is another publisher");
        assert_eq!(gaps.observe("a", 2, 899), None, "backwards is not a loss");
        gaps.forget("b");
        assert_eq!(gaps.observe("b", 1, 50), None, "what was not followed is not missing");
        assert_eq!(gaps.missing(), 3);
    }
}
