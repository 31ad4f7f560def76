//! Percentiles without allocation: counts in buckets whose width is at most 1/16 of their value.

const SUB_BITS: u32 = 4;
const SUB: usize = 1 << SUB_BITS;
const BUCKETS: usize = (64 - SUB_BITS as usize + 1) * SUB;

/// A histogram over all of `u64`.
#[derive(Debug, Clone)]
pub struct Histogram {
    counts: Box<[u32]>,
    total: u64,
    max: u64,
}

impl Default for Histogram {
    fn default() -> Self {
        Self { counts: vec![0; BUCKETS].into(), total: 0, max: 0 }
    }
}

impl Histogram {
    /// Counts a value.
    pub fn add(&mut self, value: u64) {
        if let Some(count) = self.counts.get_mut(bucket(value)) {
            *count = count.saturating_add(1);
        }
        self.total += 1;
        self.max = self.max.max(value);
    }

    /// Values counted.
    pub fn total(&self) -> u64 {
        self.total
    }

    /// The largest value; 0 when empty.
    pub fn max(&self) -> u64 {
        self.max
    }

    /// The value that `share` (0..=1) of all values do not exceed, at most 1/16 too high; 0 when empty.
    pub fn quantile(&self, share: f64) -> u64 {
        let wanted = ((self.total as f64 * share).ceil() as u64).max(1);
        let mut seen = 0;
        for (index, count) in self.counts.iter().enumerate() {
            seen += u64::from(*count);
            if seen >= wanted {
                return upper_edge(index).min(self.max);
            }
        }
        self.max
    }

    /// Forgets everything; keeps the memory.
    pub fn clear(&mut self) {
        self.counts.fill(0);
        (self.total, self.max) = (0, 0);
    }
}

fn bucket(value: u64) -> usize {
    let exponent = (64 - value.leading_zeros()).saturating_sub(SUB_BITS + 1);
    exponent as usize * SUB + (value >> exponent) as usize
}

fn upper_edge(index: usize) -> u64 {
    if index < 2 * SUB {
        return index as u64;
    }
    let exponent = (index / SUB - 1) as u32;
    let mantissa = (index % SUB + SUB) as u64;
    ((u128::from(mantissa + 1) << exponent) - 1).min(u128::from(u64::MAX)) as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn quantiles_are_those_of_the_sorted_values_within_a_sixteenth(
            values in prop::collection::vec(prop_oneof![0..100u64, any::<u64>(), 1_000..1_000_000u64], 1..300),
            share in 0.0..=1.0f64,
        ) {
            let mut histogram = Histogram::default();
            values.iter().for_each(|value| histogram.add(*value));
            let mut sorted = values.clone();
            sorted.sort_unstable();
            let rank = ((values.len() as f64 * share).ceil() as usize).max(1);
            let exact = sorted[rank - 1];
            let found = histogram.quantile(share);
            prop_assert!(found >= exact && found - exact <= exact / 16, "{found} for {exact}");
            prop_assert_eq!(histogram.max(), *sorted.last().unwrap());
        }
    }

    #[test]
    fn an_empty_histogram_says_zero() {
        let mut histogram = Histogram::default();
        histogram.add(5);
        histogram.clear();
        assert_eq!((histogram.quantile(0.5), histogram.max(), histogram.total()), (0, 0, 0));
    }
}
