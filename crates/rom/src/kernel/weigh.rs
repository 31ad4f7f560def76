//! Weighted sums of radial kernel values: most of the cost of an evaluation. A block of outputs stays in registers while
//! the loop passes over all centres, so each weight is read once.
//!
//! Products and sums are rounded apart and taken in the order of the centres: every instruction set gives the same bits.

use super::isa::Isa;

/// Sums of three quantities, by output.
pub(crate) type Sums<'a> = [&'a mut [f64]; 3];

/// `sums[q][k] = sum_c weights[c, k] factors[c][q]`, `weights` being `centres x outputs`, all outputs of a centre together.
/// Cost `3 centres x outputs` products.
pub(crate) fn weigh(weights: &[f64], factors: &[[f64; 3]], sums: Sums<'_>) {
    match Isa::detect() {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: detected just now.
        Isa::Avx512 => unsafe { avx512(weights, factors, sums) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: detected just now.
        Isa::Avx2 => unsafe { avx2(weights, factors, sums) },
        _ => blocks::<4>(weights, factors, sums),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn avx512(weights: &[f64], factors: &[[f64; 3]], sums: Sums<'_>) {
    blocks::<16>(weights, factors, sums);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn avx2(weights: &[f64], factors: &[[f64; 3]], sums: Sums<'_>) {
    blocks::<8>(weights, factors, sums);
}

/// Blocks of `N` outputs, then smaller ones for what is left.
#[inline(always)]
fn blocks<const N: usize>(weights: &[f64], factors: &[[f64; 3]], mut sums: Sums<'_>) {
    let outputs = sums[0].len();
    let mut at = 0;
    while at + N <= outputs {
        block::<N>(weights, factors, &mut sums, at);
        at += N;
    }
    while at + 4 <= outputs {
        block::<4>(weights, factors, &mut sums, at);
        at += 4;
    }
    while at < outputs {
        block::<1>(weights, factors, &mut sums, at);
        at += 1;
    }
}

/// Outputs `at .. at + N`.
#[inline(always)]
fn block<const N: usize>(weights: &[f64], factors: &[[f64; 3]], sums: &mut Sums<'_>, at: usize) {
    let mut totals = [[0.0; N]; 3];
    for (row, factors) in weights.chunks_exact(sums[0].len()).zip(factors) {
        let Some(weights) = row[at..].first_chunk::<N>() else { return };
        for (total, factor) in totals.iter_mut().zip(factors) {
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
            let factors: Vec<[f64; 3]> = centres.iter().map(|c| [c.0, c.1, c.2]).collect();
            let defined = |q: usize, k: usize| {
                (0..centres.len()).fold(0.0, |sum, c| sum + weights[c * outputs + k] * factors[c][q])
            };
            for way in [weigh, blocks::<4>, blocks::<8>, blocks::<16>] {
                let mut sums = [vec![f64::NAN; outputs], vec![f64::NAN; outputs], vec![f64::NAN; outputs]];
                way(&weights, &factors, sums.each_mut().map(Vec::as_mut_slice));
                for (q, sum) in sums.iter().enumerate() {
                    for (k, sum) in sum.iter().enumerate() {
                        prop_assert_eq!(sum.to_bits(), defined(q, k).to_bits());
                    }
                }
            }
        }
    }
}
