//! Weighted sums of radial kernel values with their gradients: most of the cost of an evaluation.
//!
//! With `d = M (x - x_k)`, kernel value `g`, `a = g'/r` and `b = a'/r`, a centre of weight `w` and slope weights `v` adds
//! ```text
//! value     w g - a (v . d)
//! gradient  (w a - b (v . d)) d - a v        over M x
//! ```
//! Eight outputs stay in registers while the loop passes over all centres, and weights lie in the order in which they are
//! read, once. A single output has eight centres in registers instead, which are added up at the end. Products and sums are rounded
//! separately and taken in one order: results are bit-identical on all instruction sets.

use super::eight::Eight;
#[cfg(target_arch = "x86_64")]
use super::eight::{Avx2, Avx512};
use super::isa::Isa;
use crate::inputs::MAX_INPUTS;

/// Outputs of a block, and centres of a group.
pub(crate) const BLOCK: usize = 8;

/// Kernel values of eight centres at a state: rows `g`, `a`, `b`, then `d`.
pub(crate) type Near = [[f64; BLOCK]; 3 + MAX_INPUTS];

/// Weights of centres: `w`, followed by `v` along each input where the centre has slopes. Centres with slopes come first.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Weights {
    pub dimensions: usize,
    /// Blocks of eight outputs.
    pub blocks: usize,
    pub centres: usize,
    /// Centres with slopes.
    pub sloped: usize,
    /// One output only: rows of eight centres. Otherwise rows of eight outputs, by block and centre.
    pub is_single: bool,
    pub values: Vec<[f64; BLOCK]>,
}

impl Weights {
    /// Weights of `outputs` outputs at `centres` centres; `weight_at(centre, row, output)` is `w` in row 0 and `v` along input `j` in row `1 + j`.
    pub(crate) fn new(
        [dimensions, outputs, centres, sloped]: [usize; 4],
        weight_at: impl Fn(usize, usize, usize) -> f64,
    ) -> Self {
        let (is_single, blocks) = (outputs == 1, outputs.div_ceil(BLOCK));
        let value = |centre: usize, row: usize, output: usize| {
            if centre < centres && output < outputs { weight_at(centre, row, output) } else { 0.0 }
        };
        let rows = |has_slopes: bool| 0..if has_slopes { 1 + dimensions } else { 1 };
        let mut values = Vec::new();
        if is_single {
            for first in (0..centres).step_by(BLOCK) {
                let along = |row: usize| move |k: usize| (first + k, row);
                for of_row in rows(first < sloped).map(along) {
                    let weight = |k: usize| {
                        let (centre, row) = of_row(k);
                        if row > 0 && centre >= sloped { 0.0 } else { value(centre, row, 0) }
                    };
                    values.push(std::array::from_fn(weight));
                }
            }
        } else {
            for (block, centre) in (0..blocks).flat_map(|block| (0..centres).map(move |c| (block, c))) {
                for row in rows(centre < sloped) {
                    values.push(std::array::from_fn(|k| value(centre, row, BLOCK * block + k)));
                }
            }
        }
        Self { dimensions, blocks, centres, sloped, is_single, values }
    }

    /// Groups of eight centres.
    pub(crate) fn groups(&self) -> usize {
        self.centres.div_ceil(BLOCK)
    }
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
        _ => plain(weights, near, gradient, sums),
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

/// Portable version, compiled once for all numbers of inputs.
fn plain(weights: &Weights, near: &[Near], gradient: bool, sums: &mut [[f64; BLOCK]]) {
    // SAFETY: plain Rust needs no instruction set.
    unsafe { blocks::<[f64; BLOCK], MAX_INPUTS>(weights, weights.dimensions, near, gradient, sums) }
}

/// Compiled for every number of inputs, so that all sums are registers.
///
/// # Safety
/// The processor has the instruction set of `E`.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
unsafe fn over<E: Eight>(weights: &Weights, near: &[Near], gradient: bool, sums: &mut [[f64; BLOCK]]) {
    macro_rules! blocks_of_dimensions {
        ($($dimensions:literal)*) => {
            match weights.dimensions {
                // SAFETY: the caller's promise.
                $($dimensions => unsafe { blocks::<E, $dimensions>(weights, $dimensions, near, gradient, sums) },)*
                // SAFETY: the caller's promise.
                _ => unsafe { blocks::<E, MAX_INPUTS>(weights, MAX_INPUTS, near, gradient, sums) },
            }
        };
    }
    blocks_of_dimensions!(0 1 2 3 4 5 6 7)
}

/// # Safety
/// As [`over`].
#[inline(always)]
unsafe fn blocks<E: Eight, const D: usize>(
    weights: &Weights,
    dimensions: usize,
    near: &[Near],
    gradient: bool,
    sums: &mut [[f64; BLOCK]],
) {
    // SAFETY: the caller's promise.
    unsafe {
        match (weights.is_single, gradient) {
            (true, true) => single::<E, D, true>(weights, dimensions, near, sums),
            (true, false) => single::<E, D, false>(weights, dimensions, near, sums),
            (false, true) => every_block::<E, D, true>(weights, dimensions, near, sums),
            (false, false) => every_block::<E, D, false>(weights, dimensions, near, sums),
        }
    }
}

/// # Safety
/// As [`over`].
#[inline(always)]
unsafe fn every_block<E: Eight, const D: usize, const GRADIENT: bool>(
    weights: &Weights,
    dimensions: usize,
    near: &[Near],
    sums: &mut [[f64; BLOCK]],
) {
    let rows = weights.centres + weights.sloped * dimensions;
    for block in 0..weights.blocks {
        let values = &weights.values[block * rows..(block + 1) * rows];
        let sums = &mut sums[block * (1 + dimensions)..(block + 1) * (1 + dimensions)];
        // SAFETY: the caller's promise.
        unsafe { block_of::<E, D, GRADIENT>(values, dimensions, near, weights.sloped, sums) };
    }
}

/// Adds the contribution of a centre with slopes; its rows of weights and the rows of `near` are in registers.
///
/// # Safety
/// As [`over`].
#[inline(always)]
unsafe fn add<E: Eight, const D: usize, const GRADIENT: bool>(
    rows: &[[f64; BLOCK]],
    dimensions: usize,
    [g, a, b]: [E; 3],
    d: &[E; D],
    value: &mut E,
    gradient: &mut [E; D],
) {
    // SAFETY: the caller's promise.
    unsafe {
        let w = E::load(&rows[0]);
        let mut along = E::splat(0.0);
        for j in 0..dimensions {
            along = along.add(E::load(&rows[1 + j]).mul(d[j]));
        }
        *value = value.add(w.mul(g).sub(a.mul(along)));
        if GRADIENT {
            let common = w.mul(a).sub(b.mul(along));
            for (j, sum) in gradient.iter_mut().enumerate().take(dimensions) {
                *sum = sum.add(common.mul(d[j]).sub(a.mul(E::load(&rows[1 + j]))));
            }
        }
    }
}

/// # Safety
/// As [`over`].
#[inline(always)]
unsafe fn block_of<E: Eight, const D: usize, const GRADIENT: bool>(
    weights: &[[f64; BLOCK]],
    dimensions: usize,
    near: &[Near],
    sloped: usize,
    sums: &mut [[f64; BLOCK]],
) {
    // SAFETY: the caller's promise.
    unsafe {
        let (mut value, mut gradient) = (E::splat(0.0), [E::splat(0.0); D]);
        let (with, without) = weights.split_at(sloped * (1 + dimensions));
        for (centre, rows) in with.chunks_exact(1 + dimensions).enumerate() {
            let (near, lane) = (&near[centre / BLOCK], centre % BLOCK);
            let mut d = [E::splat(0.0); D];
            for j in 0..dimensions {
                d[j] = E::splat(near[3 + j][lane]);
            }
            let of_kernel = [E::splat(near[0][lane]), E::splat(near[1][lane]), E::splat(near[2][lane])];
            add::<E, D, GRADIENT>(rows, dimensions, of_kernel, &d, &mut value, &mut gradient);
        }
        for (w, centre) in without.iter().zip(sloped..) {
            let (near, lane, w) = (&near[centre / BLOCK], centre % BLOCK, E::load(w));
            value = value.add(w.mul(E::splat(near[0][lane])));
            if GRADIENT {
                for (j, sum) in gradient.iter_mut().enumerate().take(dimensions) {
                    *sum = sum.add(w.mul(E::splat(near[1][lane] * near[3 + j][lane])));
                }
            }
        }
        store::<E, D, GRADIENT>(value, gradient, &mut sums[..=dimensions]);
    }
}

/// The sums of one output, in the first column.
///
/// # Safety
/// As [`over`].
#[inline(always)]
unsafe fn single<E: Eight, const D: usize, const GRADIENT: bool>(
    weights: &Weights,
    dimensions: usize,
    near: &[Near],
    sums: &mut [[f64; BLOCK]],
) {
    // SAFETY: the caller's promise.
    unsafe {
        let (mut value, mut gradient) = (E::splat(0.0), [E::splat(0.0); D]);
        let groups = weights.sloped.div_ceil(BLOCK);
        let (with, without) = weights.values.split_at(groups * (1 + dimensions));
        for (rows, near) in with.chunks_exact(1 + dimensions).zip(near) {
            let mut d = [E::splat(0.0); D];
            for j in 0..dimensions {
                d[j] = E::load(&near[3 + j]);
            }
            let of_kernel = [E::load(&near[0]), E::load(&near[1]), E::load(&near[2])];
            add::<E, D, GRADIENT>(rows, dimensions, of_kernel, &d, &mut value, &mut gradient);
        }
        for (w, near) in without.iter().zip(&near[groups..]) {
            let w = E::load(w);
            value = value.add(w.mul(E::load(&near[0])));
            if GRADIENT {
                let by_r = w.mul(E::load(&near[1]));
                for (j, sum) in gradient.iter_mut().enumerate().take(dimensions) {
                    *sum = sum.add(by_r.mul(E::load(&near[3 + j])));
                }
            }
        }
        store::<E, D, GRADIENT>(value, gradient, &mut sums[..=dimensions]);
        for row in sums.iter_mut().take(if GRADIENT { 1 + dimensions } else { 1 }) {
            row[0] = row.iter().sum();
        }
    }
}

/// # Safety
/// As [`over`].
#[inline(always)]
unsafe fn store<E: Eight, const D: usize, const GRADIENT: bool>(
    value: E,
    gradient: [E; D],
    sums: &mut [[f64; BLOCK]],
) {
    // SAFETY: the caller's promise.
    unsafe {
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

    /// Terms `[value, derivatives ...]` of one output and centre, from the definition.
    fn terms(dimensions: usize, weights: &[f64], is_sloped: bool, near: &Near, lane: usize) -> Vec<f64> {
        let [g, a, b] = [0, 1, 2].map(|row| near[row][lane]);
        let d: Vec<f64> = (0..dimensions).map(|j| near[3 + j][lane]).collect();
        let w = weights[0];
        let mut out = vec![w * g];
        if !is_sloped {
            out.extend(d.iter().map(|d| w * (a * d)));
            return out;
        }
        let along = weights[1..].iter().zip(&d).fold(0.0, |sum, (v, d)| sum + v * d);
        out[0] -= a * along;
        let common = w * a - b * along;
        out.extend(d.iter().zip(&weights[1..]).map(|(d, v)| common * d - a * v));
        out
    }

    type Way<'a> = &'a dyn Fn(&Weights, &[Near], bool, &mut [[f64; BLOCK]]);

    proptest! {
        #[test]
        fn sums_follow_the_order_of_the_centres_on_all_instruction_sets(
            dimensions in 0..=MAX_INPUTS,
            outputs in 1_usize..20,
            sloped in 0_usize..9,
            centres in proptest::collection::vec(proptest::array::uniform11(-9.0..9.0_f64), 1..40),
        ) {
            let sloped = sloped.min(centres.len());
            let number = |i: usize| ((i * 37) % 101) as f64 / 7.0 - 5.0;
            let weight = |centre: usize, row: usize, output: usize| number(31 * centre + 7 * row + 13 * output);
            let weights = Weights::new([dimensions, outputs, centres.len(), sloped], weight);
            let group = |approaches: &[[f64; 3 + MAX_INPUTS]]| -> Near {
                std::array::from_fn(|row| std::array::from_fn(|k| approaches.get(k).map_or(0.0, |near| near[row])))
            };
            let near: Vec<Near> = centres.chunks(BLOCK).map(group).collect();
            let narrow = |weights: &Weights, near: &[Near], gradient, sums: &mut [[f64; BLOCK]]| {
                match Isa::Avx2.is_available() {
                    #[cfg(target_arch = "x86_64")]
                    // SAFETY: available, as was asked just now.
                    true => unsafe { avx2(weights, near, gradient, sums) },
                    _ => weigh(weights, near, gradient, sums),
                }
            };
            for gradient in [true, false] {
                let rows = if gradient { 1 + dimensions } else { 1 };
                let sums = |way: Way<'_>| {
                    let mut sums = vec![[f64::NAN; BLOCK]; weights.blocks * (1 + dimensions)];
                    way(&weights, &near, gradient, &mut sums);
                    sums
                };
                let all = [sums(&weigh), sums(&plain), sums(&narrow)];
                for (output, row) in (0..outputs).flat_map(|output| (0..rows).map(move |row| (output, row))) {
                    let found = all.each_ref().map(|sums| sums[output / BLOCK * (1 + dimensions) + row][output % BLOCK]);
                    prop_assert!(found.iter().all(|f| f.to_bits() == found[0].to_bits()), "{found:?}");
                    let (mut wanted, mut size) = (0.0, 0.0);
                    for centre in 0..centres.len() {
                        let weights: Vec<f64> = (0..=dimensions).map(|row| weight(centre, row, output)).collect();
                        let term = terms(dimensions, &weights, centre < sloped, &near[centre / BLOCK], centre % BLOCK)[row];
                        (wanted, size) = (wanted + term, size + term.abs());
                    }
                    if outputs > 1 {
                        prop_assert_eq!(found[0].to_bits(), wanted.to_bits());
                    } else {
                        // Another order of the sum.
                        prop_assert!((found[0] - wanted).abs() <= 1e-13 * size, "{} {wanted}", found[0]);
                    }
                }
            }
        }
    }
}
