//! Weighted sums of radial kernel values with their gradients: most of the cost of an evaluation.
//!
//! With `d = M (x - x_k)`, kernel value `g`, `a = g'/r` and `b = a'/r`, a centre of weight `w` and slope weights `v` adds
//! ```text
//! value     w g - a (v . d)
//! gradient  (w a - b (v . d)) d - a v        over M x
//! ```
//! Eight outputs stay in registers while the loop passes over all centres, and weights lie in the order in which they are
//! read, once. Products and sums are rounded apart and taken in the order of the centres: every instruction set gives the
//! same bits.

use super::eight::Eight;
#[cfg(target_arch = "x86_64")]
use super::eight::{Avx2, Avx512};
use super::isa::Isa;
use crate::inputs::MAX_INPUTS;

/// Outputs of a block.
pub(crate) const BLOCK: usize = 8;

/// What a centre is to a state: `g`, `a`, `b`, then `d`.
pub(crate) type Near = [f64; 3 + MAX_INPUTS];

/// Weights of centres in blocks of outputs: by block and centre `w`, followed by `v` along each input where the centre has
/// slopes. Centres with slopes come first.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Weights {
    pub dimensions: usize,
    pub blocks: usize,
    /// Centres with slopes.
    pub sloped: usize,
    pub values: Vec<[f64; BLOCK]>,
}

/// Sums by block: values in the first row, then a row of derivatives along each input where `gradient` is asked for. `sums`
/// holds `blocks x (1 + dimensions)` rows. Cost a centre and output: 1 product, 3 + `dimensions` with slopes; with the
/// gradient `2 + dimensions` and `4 + 3 dimensions`.
pub(crate) fn weigh(weights: &Weights, near: &[Near], gradient: bool, sums: &mut [[f64; BLOCK]]) {
    match Isa::detect() {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: detected just now.
        Isa::Avx512 => unsafe { avx512(weights, near, gradient, sums) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: detected just now.
        Isa::Avx2 => unsafe { avx2(weights, near, gradient, sums) },
        // SAFETY: plain Rust needs no instruction set.
        _ => unsafe { over::<[f64; BLOCK]>(weights, near, gradient, sums) },
    }
}

/// # Safety
/// The processor has AVX-512 F.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
unsafe fn avx512(weights: &Weights, near: &[Near], gradient: bool, sums: &mut [[f64; BLOCK]]) {
    // SAFETY: the caller's promise.
    unsafe { over::<Avx512>(weights, near, gradient, sums) }
}

/// # Safety
/// The processor has AVX2.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
unsafe fn avx2(weights: &Weights, near: &[Near], gradient: bool, sums: &mut [[f64; BLOCK]]) {
    // SAFETY: the caller's promise.
    unsafe { over::<Avx2>(weights, near, gradient, sums) }
}

/// # Safety
/// The processor has the instruction set of `E`.
#[inline(always)]
unsafe fn over<E: Eight>(weights: &Weights, near: &[Near], gradient: bool, sums: &mut [[f64; BLOCK]]) {
    macro_rules! of {
        ($($dimensions:literal)*) => {
            match weights.dimensions {
                // SAFETY: the caller's promise.
                $($dimensions => unsafe { blocks::<E, $dimensions>(weights, near, gradient, sums) },)*
                // SAFETY: the caller's promise.
                _ => unsafe { blocks::<E, MAX_INPUTS>(weights, near, gradient, sums) },
            }
        };
    }
    of!(0 1 2 3 4 5 6 7)
}

/// # Safety
/// As [`over`].
#[inline(always)]
unsafe fn blocks<E: Eight, const D: usize>(
    weights: &Weights,
    near: &[Near],
    gradient: bool,
    sums: &mut [[f64; BLOCK]],
) {
    let rows = near.len() + weights.sloped * D;
    for block in 0..weights.blocks {
        let values = &weights.values[block * rows..(block + 1) * rows];
        let sums = &mut sums[block * (1 + D)..(block + 1) * (1 + D)];
        // SAFETY: the caller's promise.
        unsafe {
            if gradient {
                block_of::<E, D, true>(values, near, weights.sloped, sums);
            } else {
                block_of::<E, D, false>(values, near, weights.sloped, sums);
            }
        }
    }
}

/// # Safety
/// As [`over`].
#[inline(always)]
unsafe fn block_of<E: Eight, const D: usize, const GRADIENT: bool>(
    weights: &[[f64; BLOCK]],
    near: &[Near],
    sloped: usize,
    sums: &mut [[f64; BLOCK]],
) {
    // SAFETY: the caller's promise.
    unsafe {
        let (mut value, mut gradient) = (E::splat(0.0), [E::splat(0.0); D]);
        let (with, without) = weights.split_at(sloped * (1 + D));
        for (rows, near) in with.chunks_exact(1 + D).zip(near) {
            let (w, g, a, b) = (E::load(&rows[0]), E::splat(near[0]), E::splat(near[1]), E::splat(near[2]));
            let mut along = E::splat(0.0);
            for j in 0..D {
                along = along.add(E::load(&rows[1 + j]).mul(E::splat(near[3 + j])));
            }
            value = value.add(w.mul(g).sub(a.mul(along)));
            if GRADIENT {
                let common = w.mul(a).sub(b.mul(along));
                for (j, sum) in gradient.iter_mut().enumerate() {
                    let term = common.mul(E::splat(near[3 + j])).sub(a.mul(E::load(&rows[1 + j])));
                    *sum = sum.add(term);
                }
            }
        }
        for (w, near) in without.iter().zip(&near[sloped..]) {
            let w = E::load(w);
            value = value.add(w.mul(E::splat(near[0])));
            if GRADIENT {
                for (j, sum) in gradient.iter_mut().enumerate() {
                    *sum = sum.add(w.mul(E::splat(near[1] * near[3 + j])));
                }
            }
        }
        value.store(&mut sums[0]);
        if GRADIENT {
            for (row, sum) in sums[1..].iter_mut().zip(gradient) {
                sum.store(row);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// By the definition, one output after the other.
    fn defined(weights: &Weights, near: &[Near], block: usize, k: usize) -> Vec<f64> {
        let dimensions = weights.dimensions;
        let mut sums = vec![0.0; 1 + dimensions];
        let mut rows = weights.values[block * (near.len() + weights.sloped * dimensions)..].iter();
        for (at, near) in near.iter().enumerate() {
            let ([g, a, b], d) = ([near[0], near[1], near[2]], &near[3..3 + dimensions]);
            let w = rows.next().expect("a row a centre")[k];
            if at >= weights.sloped {
                sums[0] += w * g;
                (0..dimensions).for_each(|j| sums[1 + j] += w * (a * d[j]));
                continue;
            }
            let v: Vec<f64> = rows.by_ref().take(dimensions).map(|row| row[k]).collect();
            let along = v.iter().zip(d).fold(0.0, |sum, (v, d)| sum + v * d);
            sums[0] += w * g - a * along;
            let common = w * a - b * along;
            (0..dimensions).for_each(|j| sums[1 + j] += common * d[j] - a * v[j]);
        }
        sums
    }

    proptest! {
        #[test]
        fn every_instruction_set_gives_the_sums_in_the_order_of_the_centres(
            dimensions in 1..=MAX_INPUTS,
            blocks in 1_usize..4,
            sloped in 0_usize..9,
            near in proptest::collection::vec(proptest::array::uniform11(-9.0..9.0_f64), 1..20),
        ) {
            let sloped = sloped.min(near.len());
            let count = blocks * (near.len() + sloped * dimensions);
            let number = |i: usize| ((i * 37) % 101) as f64 / 7.0 - 5.0;
            let values = (0..count).map(|i| std::array::from_fn(|k| number(BLOCK * i + k))).collect();
            let weights = Weights { dimensions, blocks, sloped, values };
            let portable = |weights: &Weights, near: &[Near], gradient, sums: &mut [[f64; BLOCK]]| {
                // SAFETY: plain Rust.
                unsafe { over::<[f64; BLOCK]>(weights, near, gradient, sums) }
            };
            let narrow = |weights: &Weights, near: &[Near], gradient, sums: &mut [[f64; BLOCK]]| {
                match Isa::Avx2.is_available() {
                    #[cfg(target_arch = "x86_64")]
                    // SAFETY: available, as was asked just now.
                    true => unsafe { avx2(weights, near, gradient, sums) },
                    _ => weigh(weights, near, gradient, sums),
                }
            };
            for way in [weigh, portable, narrow] {
                for gradient in [true, false] {
                    let mut sums = vec![[f64::NAN; BLOCK]; blocks * (1 + dimensions)];
                    way(&weights, &near, gradient, &mut sums);
                    for (at, rows) in sums.chunks_exact(1 + dimensions).enumerate() {
                        for k in 0..BLOCK {
                            let wanted = defined(&weights, &near, at, k);
                            let asked = if gradient { 1 + dimensions } else { 1 };
                            for (row, wanted) in rows.iter().zip(&wanted).take(asked) {
                                prop_assert_eq!(row[k].to_bits(), wanted.to_bits());
                            }
                        }
                    }
                }
            }
        }
    }
}
