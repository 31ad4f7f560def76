//! Coefficients of rows in i16 and i8 as whole numbers of a unit, so that sums over two or four rows are one instruction. The unit is as
//! fine as the sums allow, which stay below 2^31.

/// Low parts of a unit of i16.
pub(super) const LOW_PARTS: f32 = 256.0;
/// Sum of the high parts of factors of i16 at most, but for their rounding: times 32767 it stays below 2^30, and 511 low parts of 128 times
/// 32767 below 2^31.
pub(super) const PAIRS_MAX: f32 = 32000.0;
/// Largest factor of i8: its high part is an i8, and 511 times 127 of it stay below 2^31.
pub(super) const FOURS_MAX: f32 = 32512.0;

/// 1.5 times 2^23: between whole numbers near it there is no f32.
const WHOLE: f32 = 12_582_912.0;

/// The nearest whole number, the even one of two, of a number below 2^22.
#[inline(always)]
fn nearest(value: f32) -> i32 {
    (value + WHOLE - WHOLE) as i32
}

/// Sum of their magnitudes, in the order of sixteen lanes, and the largest.
#[inline(always)]
fn sizes(factors: &[f32]) -> (f32, f32) {
    let (mut sums, mut largest) = ([0.0_f32; 16], 0.0_f32);
    for sixteen in factors.chunks(16) {
        for (sum, factor) in sums.iter_mut().zip(sixteen) {
            *sum += factor.abs();
            largest = if largest >= factor.abs() { largest } else { factor.abs() };
        }
    }
    for half in [8, 4, 2, 1] {
        for k in 0..half {
            sums[k] += sums[half + k];
        }
    }
    (sums[0], largest)
}

/// How many steps of a unit one is, so that `size` is `most`, and the unit: neither of what is hardly more than nothing, and no number where
/// `sum`, of all magnitudes, is none.
#[inline(always)]
pub(super) fn scale(most: f32, size: f32, sum: f32) -> (f32, f32) {
    let by = most / size;
    match () {
        () if !sum.is_finite() => (0.0, f32::NAN),
        () if size > 0.0 && by.is_finite() => (by, 1.0 / by),
        () => (0.0, 0.0),
    }
}

/// Factors of rows in i16 as `high + low / 256` of a unit, which is given back. One that is no number makes the unit none.
#[inline(always)]
pub(super) fn pairs(factors: &[f32], high: &mut [i16], low: &mut [i16]) -> f32 {
    let (sum, _) = sizes(factors);
    let (by, unit) = scale(PAIRS_MAX, sum, sum);
    high.fill(0);
    low.fill(0);
    for ((factor, high), low) in factors.iter().zip(high).zip(low) {
        let steps = factor * by;
        let whole = nearest(steps);
        (*high, *low) = (whole as i16, nearest((steps - whole as f32) * LOW_PARTS) as i16);
    }
    unit
}

/// Factors of rows in i8 in whole numbers of a unit, and the same in parts, 256 times a high part and the low one: the sums of both parts,
/// and the unit. One that is no number makes the unit none.
#[inline(always)]
pub(super) fn fours(factors: &[f32], values: &mut [i16], high: &mut [i8], low: &mut [i8]) -> ([i32; 2], f32) {
    let (sum, largest) = sizes(factors);
    let (by, unit) = scale(FOURS_MAX, largest, sum);
    values.fill(0);
    high.fill(0);
    low.fill(0);
    let mut sums = [0; 2];
    for (((factor, value), high), low) in factors.iter().zip(values).zip(high).zip(low) {
        let whole = nearest(factor * by);
        let of_256 = (whole + 128) >> 8;
        let rest = whole - 256 * of_256;
        (*value, *high, *low) = (whole as i16, of_256 as i8, rest as i8);
        sums[0] += of_256;
        sums[1] += rest;
    }
    (sums, unit)
}

#[cfg(test)]
mod tests {
    use super::super::MAX_ROWS;
    use super::super::lanes::{Lanes, portable::Portable};
    use super::*;
    use proptest::prelude::*;

    /// High and low parts, and the unit.
    fn made_pairs<V: Lanes>(factors: &[f32]) -> (Vec<i16>, Vec<i16>, f32) {
        let room = || vec![-1; factors.len().next_multiple_of(16)];
        let (mut high, mut low) = (room(), room());
        // SAFETY: the instruction set is there, and so is room.
        let unit = unsafe { V::whole_pairs(factors, &mut high, &mut low) };
        (high, low, unit)
    }

    /// High and low parts, their sums, and the unit.
    fn made_fours<V: Lanes>(factors: &[f32]) -> ([Vec<i8>; 2], [i32; 2], f32) {
        let room = factors.len().next_multiple_of(16);
        let (mut values, mut high, mut low) = (vec![0; room], vec![-1; room], vec![-1; room]);
        // SAFETY: the instruction set is there, and so is room.
        let (sums, unit) = unsafe { V::whole_fours(factors, &mut values, &mut high, &mut low) };
        ([high, low], sums, unit)
    }

    fn check<V: Lanes>(factors: &[f32]) -> Result<(), TestCaseError> {
        let size: f32 = factors.iter().map(|factor| factor.abs()).sum();
        let (high, low, unit) = made_pairs::<V>(factors);
        let (mut highs, mut lows) = (0_i64, 0_i64);
        for (at, factor) in factors.iter().enumerate() {
            let found = (f32::from(high[at]) + f32::from(low[at]) / LOW_PARTS) * unit;
            prop_assert!((found - factor).abs() <= 2e-7 * size, "{found} for {factor} of {size}");
            highs += 32767 * i64::from(high[at]).abs();
            lows += 32767 * i64::from(low[at]).abs();
        }
        prop_assert!(highs <= i64::from(i32::MAX) && lows <= i64::from(i32::MAX), "{highs} {lows}");
        prop_assert!(high[factors.len()..].iter().chain(&low[factors.len()..]).all(|&beyond| beyond == 0));

        let (parts, sums, unit) = made_fours::<V>(factors);
        let largest = factors.iter().fold(0.0, |most: f32, factor| most.max(factor.abs()));
        let mut whole = 0_i64;
        for (at, factor) in factors.iter().enumerate() {
            let value = 256 * i32::from(parts[0][at]) + i32::from(parts[1][at]);
            prop_assert!((value as f32 * unit - factor).abs() <= 0.51 * largest / FOURS_MAX);
            whole += 127 * i64::from(value).abs();
        }
        prop_assert!(whole <= i64::from(i32::MAX), "{whole}");
        for (part, sum) in parts.iter().zip(sums) {
            prop_assert_eq!(part.iter().map(|&of| i32::from(of)).sum::<i32>(), sum);
            prop_assert!(part[factors.len()..].iter().all(|&beyond| beyond == 0));
        }
        Ok(())
    }

    fn check_odd<V: Lanes>() {
        for odd in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert!(made_pairs::<V>(&[1.0, odd, 2.0]).2.is_nan());
            assert!(made_fours::<V>(&[1.0, odd, 2.0]).2.is_nan());
        }
        for nothing in [0.0, f32::from_bits(1)] {
            assert_eq!(made_pairs::<V>(&[nothing; 2]), (vec![0; 16], vec![0; 16], 0.0));
            assert_eq!(made_fours::<V>(&[nothing; 2]), ([vec![0; 16], vec![0; 16]], [0; 2], 0.0));
        }
        assert_eq!((made_pairs::<V>(&[]).2, made_fours::<V>(&[]).2), (0.0, 0.0));
    }

    proptest! {
        #[test]
        fn whole_numbers_of_the_unit_are_the_factors_and_no_sum_leaves_an_i32(
            factors in proptest::collection::vec((-1.0..1.0_f32, -30..30_i32), 0..MAX_ROWS),
        ) {
            let factors: Vec<f32> = factors.into_iter().map(|(value, octave)| value * (octave as f32).exp2()).collect();
            check::<Portable>(&factors)?;
            let (mut values, mut high, mut low) = (vec![0; factors.len()], vec![0; factors.len()], vec![0; factors.len()]);
            fours(&factors, &mut values, &mut high, &mut low);
            for (at, value) in values.into_iter().enumerate() {
                prop_assert_eq!(256 * i32::from(high[at]) + i32::from(low[at]), i32::from(value));
            }
            #[cfg(target_arch = "x86_64")]
            if std::is_x86_feature_detected!("avx512f") {
                check::<super::super::lanes::avx512::Avx512>(&factors)?;
            }
        }
    }

    #[test]
    fn factors_that_are_no_numbers_or_hardly_any_are_told() {
        check_odd::<Portable>();
        #[cfg(target_arch = "x86_64")]
        if std::is_x86_feature_detected!("avx512f") {
            check_odd::<super::super::lanes::avx512::Avx512>();
        }
    }
}
