//! Weighted sums of radial kernel values: what a state costs. A block of outputs stays in registers while all centres go
//! by, so each weight is read once and nothing else moves.
//!
//! Products and sums are rounded apart and taken in the order of the centres: every instruction set gives the same bits.

use super::isa::Isa;

/// Kernel values at a query and what they are weighed with.
#[derive(Clone, Copy)]
pub(crate) struct Kernels<'a> {
    /// `centres x outputs`, all outputs of a centre together.
    pub weights: &'a [f64],
    /// By centre.
    pub values: &'a [f64],
    /// By centre: slopes along both inputs.
    pub slopes: &'a [[f64; 2]],
}

/// By output: value and slopes along both inputs.
pub(crate) type Sums<'a> = [&'a mut [f64]; 3];

/// `sums[q][k] = sum_c weights[c, k] q_c` for the value and both slopes `q`. Cost `3 centres x outputs` products.
pub(crate) fn weigh(kernels: Kernels<'_>, sums: Sums<'_>) {
    match Isa::detect() {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: detected just now.
        Isa::Avx512 => unsafe { avx512(kernels, sums) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: detected just now.
        Isa::Avx2 => unsafe { avx2(kernels, sums) },
        _ => blocks::<4>(kernels, sums),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn avx512(kernels: Kernels<'_>, sums: Sums<'_>) {
    blocks::<16>(kernels, sums);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn avx2(kernels: Kernels<'_>, sums: Sums<'_>) {
    blocks::<8>(kernels, sums);
}

/// Blocks of `N` outputs, then smaller ones for what is left.
#[inline(always)]
fn blocks<const N: usize>(kernels: Kernels<'_>, mut sums: Sums<'_>) {
    let outputs = sums[0].len();
    let mut at = 0;
    while at + N <= outputs {
        block::<N>(kernels, &mut sums, at);
        at += N;
    }
    while at + 4 <= outputs {
        block::<4>(kernels, &mut sums, at);
        at += 4;
    }
    while at < outputs {
        block::<1>(kernels, &mut sums, at);
        at += 1;
    }
}

/// Outputs `at .. at + N`.
#[inline(always)]
fn block<const N: usize>(kernels: Kernels<'_>, sums: &mut Sums<'_>, at: usize) {
    let mut totals = [[0.0; N]; 3];
    let rows = kernels.weights.chunks_exact(sums[0].len());
    for ((row, value), slope) in rows.zip(kernels.values).zip(kernels.slopes) {
        let Some(weights) = row[at..].first_chunk::<N>() else { return };
        for (total, factor) in totals.iter_mut().zip([*value, slope[0], slope[1]]) {
            for (total, weight) in total.iter_mut().zip(weights) {
                *total += weight * factor;
            }
        }
    }
    for (sum, total) in sums.iter_mut().zip(&totals) {
        sum[at..at + N].copy_from_slice(total);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Every block size against the definition, to the bit.
        #[test]
        fn every_block_size_gives_the_sum_in_the_order_of_the_centres(
            outputs in 1_usize..40,
            centres in proptest::collection::vec((-9.0..9.0_f64, -9.0..9.0_f64, -9.0..9.0_f64), 1..30),
        ) {
            let weights: Vec<f64> = (0..outputs * centres.len()).map(|i| ((i * 37) % 101) as f64 / 7.0 - 5.0).collect();
            let values: Vec<f64> = centres.iter().map(|c| c.0).collect();
            let slopes: Vec<[f64; 2]> = centres.iter().map(|c| [c.1, c.2]).collect();
            let kernels = Kernels { weights: &weights, values: &values, slopes: &slopes };
            let defined = |factor: &dyn Fn(usize) -> f64, k: usize| {
                (0..centres.len()).fold(0.0, |sum, c| sum + weights[c * outputs + k] * factor(c))
            };
            for way in [weigh, blocks::<4>, blocks::<8>, blocks::<16>] {
                let mut sums = vec![f64::NAN; 3 * outputs];
                let (value, rest) = sums.split_at_mut(outputs);
                let (dx0, dx1) = rest.split_at_mut(outputs);
                way(kernels, [value, dx0, dx1]);
                for k in 0..outputs {
                    prop_assert_eq!(sums[k].to_bits(), defined(&|c| values[c], k).to_bits());
                    prop_assert_eq!(sums[outputs + k].to_bits(), defined(&|c| slopes[c][0], k).to_bits());
                    prop_assert_eq!(sums[2 * outputs + k].to_bits(), defined(&|c| slopes[c][1], k).to_bits());
                }
            }
        }
    }
}
