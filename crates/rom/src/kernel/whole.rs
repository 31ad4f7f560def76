//! Coefficients of rows in i16 and i8 as whole numbers of a unit, so that sums over two or four rows are one instruction. The unit is as
//! fine as the sums allow, which stay below 2^31.

use super::lanes::{Four, LOW_PARTS, Pair};

/// Sum of the high parts of factors of i16 at most, but for their rounding: times 32767 it stays below 2^30, and 511 low parts of 128 times
/// 32767 below 2^31.
const PAIRS_MAX: f32 = 32000.0;
/// Largest factor of i8: its high part is an i8, and 511 times 127 of it stay below 2^31.
const FOURS_MAX: f32 = 32512.0;

/// The nearest whole number of a number that an i32 holds.
#[inline(always)]
fn nearest(value: f32) -> i32 {
    (value + 0.5_f32.copysign(value)) as i32
}

#[inline(always)]
fn sum_of_magnitudes(factors: &[f32]) -> f32 {
    let mut sum = 0.0;
    for factor in factors {
        sum += factor.abs();
    }
    sum
}

/// Factors of rows in i16 and their unit. A factor that is no number makes the unit none.
#[inline(always)]
pub(super) fn pairs(factors: &[f32], pairs: &mut [Pair]) -> f32 {
    let sum = sum_of_magnitudes(factors);
    if !sum.is_finite() {
        pairs.fill(Pair::default());
        return f32::NAN;
    }
    let by = if sum > 0.0 { PAIRS_MAX / sum } else { 0.0 };
    for (at, pair) in pairs.iter_mut().enumerate() {
        for k in 0..2 {
            let steps = factors.get(2 * at + k).map_or(0.0, |factor| factor * by);
            let high = nearest(steps);
            (pair.high[k], pair.low[k]) = (high as i16, nearest((steps - high as f32) * LOW_PARTS) as i16);
        }
    }
    if by > 0.0 { 1.0 / by } else { 0.0 }
}

/// Factors of rows in i8, the sums of their high and low parts, and their unit. A factor that is no number makes the unit none.
#[inline(always)]
pub(super) fn fours(factors: &[f32], fours: &mut [Four]) -> ([i32; 2], f32) {
    if !sum_of_magnitudes(factors).is_finite() {
        fours.fill(Four::default());
        return ([0; 2], f32::NAN);
    }
    let mut largest = 0.0_f32;
    for factor in factors {
        largest = if largest >= factor.abs() { largest } else { factor.abs() };
    }
    let by = if largest > 0.0 { FOURS_MAX / largest } else { 0.0 };
    let mut sums = [0; 2];
    for (at, four) in fours.iter_mut().enumerate() {
        *four = Four::default();
        for k in 0..4 {
            let whole = nearest(factors.get(4 * at + k).map_or(0.0, |factor| factor * by));
            let high = (whole + 128) >> 8;
            let low = whole - 256 * high;
            four.values[k] = whole as i16;
            four.high |= (high & 0xff) << (8 * k);
            four.low |= (low & 0xff) << (8 * k);
            sums[0] += high;
            sums[1] += low;
        }
    }
    (sums, if by > 0.0 { 1.0 / by } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::MAX_ROWS;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn whole_numbers_of_the_unit_are_the_factors_and_no_sum_leaves_an_i32(
            factors in proptest::collection::vec((-1.0..1.0_f32, -30..30_i32), 0..MAX_ROWS),
        ) {
            let factors: Vec<f32> = factors.into_iter().map(|(value, octave)| value * (octave as f32).exp2()).collect();
            let size = sum_of_magnitudes(&factors);
            let mut two = vec![Pair::default(); factors.len().div_ceil(2)];
            let unit = pairs(&factors, &mut two);
            let (mut highs, mut lows) = (0_i64, 0_i64);
            for (at, factor) in factors.iter().enumerate() {
                let (high, low) = (two[at / 2].high[at % 2], two[at / 2].low[at % 2]);
                let found = (f32::from(high) + f32::from(low) / LOW_PARTS) * unit;
                prop_assert!((found - factor).abs() <= 2e-7 * size, "{found} for {factor} of {size}");
                highs += 32767 * i64::from(high).abs();
                lows += 32767 * i64::from(low).abs();
            }
            prop_assert!(highs <= i64::from(i32::MAX) && lows <= i64::from(i32::MAX), "{highs} {lows}");

            let mut four = vec![Four::default(); factors.len().div_ceil(4)];
            let (sums, unit) = fours(&factors, &mut four);
            let largest = factors.iter().fold(0.0, |most: f32, factor| most.max(factor.abs()));
            let part = |word: i32, k: usize| i32::from(word.to_le_bytes()[k].cast_signed());
            let (mut found_sums, mut whole) = ([0; 2], 0_i64);
            for (at, factor) in factors.iter().enumerate() {
                let (of, k) = (four[at / 4], at % 4);
                let value = i32::from(of.values[k]);
                prop_assert_eq!(256 * part(of.high, k) + part(of.low, k), value);
                prop_assert!((value as f32 * unit - factor).abs() <= 0.51 * largest / FOURS_MAX);
                found_sums = [found_sums[0] + part(of.high, k), found_sums[1] + part(of.low, k)];
                whole += 127 * i64::from(value).abs();
            }
            prop_assert_eq!(found_sums, sums);
            prop_assert!(whole <= i64::from(i32::MAX), "{whole}");
        }
    }

    #[test]
    fn a_factor_that_is_no_number_makes_the_unit_none() {
        for odd in [f32::NAN, f32::INFINITY] {
            let factors = [1.0, odd, 2.0];
            assert!(pairs(&factors, &mut [Pair::default(); 2]).is_nan());
            assert!(fours(&factors, &mut [Four::default()]).1.is_nan());
        }
        assert_eq!(pairs(&[0.0; 2], &mut [Pair::default()]), 0.0);
        assert_eq!(fours(&[0.0; 4], &mut [Four::default()]), ([0; 2], 0.0));
    }
}
