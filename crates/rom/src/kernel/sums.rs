//! Interpolants in the layout for evaluation: several with one kernel in one pass, weights in reading order. Kernel values,
//! sums and tail are the same to the last bit with every instruction set: products and sums are rounded separately.

use super::isa::with_widest_vectors;
use super::weigh::{BLOCK, Near, Weights, weigh};
use crate::inputs::{MAX_INPUTS, Point};
use crate::interpolant::{Interpolant, Metric};
use crate::radial::{KernelKind, Tail};

/// Interpolants over the same centres and with the same kernel, their outputs side by side.
#[derive(Clone, Debug)]
pub(crate) struct Sums {
    kernel: KernelKind,
    tail: Tail,
    metric: Metric,
    dimensions: usize,
    outputs: usize,
    /// Coordinates of the centres, per group of eight and input. Centres with slopes are first; unused entries are 0.
    centres: Vec<[f64; BLOCK]>,
    weights: Weights,
    /// `tail terms x outputs`.
    tail_weights: Vec<f64>,
}

/// Reusable memory of [`Sums::evaluate`].
#[derive(Clone, Debug, Default)]
pub(crate) struct Scratch {
    near: Vec<Near>,
    sums: Vec<[f64; BLOCK]>,
}

/// No centre yet.
const NOWHERE: Near = [[0.0; BLOCK]; 3 + MAX_INPUTS];

impl Scratch {
    /// Enlarges the memory to at least that of `other`.
    pub fn reserve(&mut self, other: &Self) {
        grow(&mut self.near, other.near.len(), NOWHERE);
        grow(&mut self.sums, other.sums.len(), [0.0; BLOCK]);
    }

    /// Memory for all of these sums.
    pub fn of<'a>(all: impl Iterator<Item = &'a Sums>) -> Self {
        let mut scratch = Self::default();
        for sums in all {
            scratch.reserve_for(&sums.weights);
        }
        scratch
    }

    /// Enlarges the memory for sums with these weights.
    pub fn reserve_for(&mut self, weights: &Weights) {
        grow(&mut self.near, weights.groups(), NOWHERE);
        grow(&mut self.sums, weights.blocks * (1 + weights.dimensions), [0.0; BLOCK]);
    }

    /// `sum_k weights_k factors_k` for weights over no input.
    pub fn weighted(&mut self, weights: &Weights, factors: &[f64]) -> &[[f64; BLOCK]] {
        let near = &mut self.near[..weights.groups()];
        for (near, factors) in near.iter_mut().zip(factors.chunks(BLOCK)) {
            near[0] = std::array::from_fn(|k| factors.get(k).copied().unwrap_or(0.0));
        }
        weigh(weights, near, false, &mut self.sums);
        &self.sums
    }
}

fn grow<T: Copy>(values: &mut Vec<T>, count: usize, value: T) {
    if values.len() < count {
        values.resize(count, value);
    }
}

impl Sums {
    /// Sums of at least one interpolant; all have one kernel ([`Interpolant::shares_kernel_with`]).
    pub fn new(parts: &[&Interpolant]) -> Self {
        let Interpolant { kernel, tail, metric, dimensions, .. } = *parts[0];
        let centres = parts[0].centre_count();
        let mut slopes = vec![[None; MAX_INPUTS]; centres];
        for (index, slope) in parts[0].slopes.iter().enumerate() {
            slopes[slope.centre as usize][slope.axis as usize] = Some(centres + index);
        }
        let has_slopes = |centre: &usize| slopes[*centre].iter().any(Option::is_some);
        let (mut order, without): (Vec<usize>, Vec<usize>) = (0..centres).partition(has_slopes);
        let sloped = order.len();
        order.extend(without);
        let outputs = parts.iter().map(|part| part.outputs).sum();
        let merged = |rows: usize, values: fn(&Interpolant) -> &[f64]| -> Vec<f64> {
            let row = |index: usize| {
                parts.iter().flat_map(move |part| {
                    values(part)[index * part.outputs..(index + 1) * part.outputs].iter()
                })
            };
            (0..rows).flat_map(row).copied().collect()
        };
        let rows = merged(parts[0].terms(), |part| &part.weights);
        let value = |row: Option<usize>, output: usize| row.map_or(0.0, |row| rows[row * outputs + output]);
        // Slope weights by scaled input as those over `M x`.
        let weight = |index: usize, row: usize, output: usize| {
            if row == 0 {
                return value(Some(order[index]), output);
            }
            metric.apply(&slopes[order[index]].map(|slope| value(slope, output)))[row - 1]
        };
        let weights = Weights::new([dimensions, outputs, centres, sloped], weight);
        let place = |index: usize, input: usize| {
            order.get(index).map_or(0.0, |c| parts[0].centres[c * dimensions + input])
        };
        let lanes = |group: usize, input: usize| std::array::from_fn(|k| place(BLOCK * group + k, input));
        let row = |group: usize| (0..dimensions).map(move |input| (group, input));
        Self {
            kernel,
            tail,
            metric,
            dimensions,
            outputs,
            centres: (0..weights.groups()).flat_map(row).map(|(group, input)| lanes(group, input)).collect(),
            weights,
            tail_weights: merged(tail.terms(dimensions), |part| &part.tail_weights),
        }
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// Value and, if requested, gradient over scaled inputs of every output at `x`. No allocation if `scratch` was made for these
    /// sums. Cost: see [`weigh`].
    pub fn evaluate(
        &self,
        x: &Point,
        scratch: &mut Scratch,
        value: &mut [f64],
        gradient: Option<Gradient<'_>>,
    ) {
        let u = self.metric.apply(x);
        let near = &mut scratch.near[..self.weights.groups()];
        approach(self.kernel, &u, self.dimensions, &self.centres, near);
        weigh(&self.weights, near, gradient.is_some(), &mut scratch.sums);
        let rows = 1 + self.dimensions;
        let sum = |k: usize, row: usize| scratch.sums[k / BLOCK * rows + row][k % BLOCK];
        value.iter_mut().enumerate().for_each(|(k, value)| *value = sum(k, 0));
        let mut by = gradient;
        if let Some(by) = &mut by {
            for k in 0..self.outputs {
                let over_u = std::array::from_fn(|j| if j < self.dimensions { sum(k, 1 + j) } else { 0.0 });
                let slopes: Point = self.metric.pull_back(over_u);
                by.iter_mut().zip(slopes).take(self.dimensions).for_each(|(row, slope)| row[k] = slope);
            }
        }
        let tail = Polynomial {
            tail: self.tail,
            metric: &self.metric,
            dimensions: self.dimensions,
            weights: &self.tail_weights,
        };
        tail.add(&u, value, by);
    }
}

impl Interpolant {
    /// Values only, allocated: for training.
    pub fn values_at(&self, x: &Point) -> Vec<f64> {
        self.value_and_gradient_at(x).0
    }

    /// Derivatives by each scaled input, allocated: for training.
    pub fn gradient_at(&self, x: &Point) -> Vec<Vec<f64>> {
        self.value_and_gradient_at(x).1.into_iter().take(self.dimensions).collect()
    }

    /// Values, and derivatives by each input, allocated: for training.
    pub fn value_and_gradient_at(&self, x: &Point) -> (Vec<f64>, [Vec<f64>; MAX_INPUTS]) {
        let sums = Sums::new(&[self]);
        let mut value = vec![0.0; self.outputs];
        let mut rows: [Vec<f64>; MAX_INPUTS] = std::array::from_fn(|_| vec![0.0; self.outputs]);
        let gradient = Some(rows.each_mut().map(Vec::as_mut_slice));
        sums.evaluate(x, &mut Scratch::of([&sums].into_iter()), &mut value, gradient);
        (value, rows)
    }
}

with_widest_vectors! {
    /// Evaluates all centres at the state `u = M x`. `centres` holds their inputs per group and input, eight centres per row.
    pub(crate) fn approach(
        kernel: KernelKind,
        u: &Point,
        dimensions: usize,
        centres: &[[f64; BLOCK]],
        near: &mut [Near],
    ) = approach_groups;
}

#[inline(always)]
fn approach_groups(
    kernel: KernelKind,
    u: &Point,
    dimensions: usize,
    centres: &[[f64; BLOCK]],
    near: &mut [Near],
) {
    // Of a kernel that is known where the loop stands, not asked for at every centre.
    macro_rules! known {
        ($($kind:pat => $same:expr),*) => {
            match kernel {
                $($kind => {
                    for (centres, near) in centres.chunks_exact(dimensions.max(1)).zip(near) {
                        approach_one($same, u, centres, near);
                    }
                })*
            }
        };
    }
    known!(
        KernelKind::Linear => KernelKind::Linear,
        KernelKind::ThinPlate => KernelKind::ThinPlate,
        KernelKind::Cubic => KernelKind::Cubic,
        KernelKind::Quintic => KernelKind::Quintic,
        KernelKind::Gaussian { shape } => KernelKind::Gaussian { shape },
        KernelKind::Matern72 { length } => KernelKind::Matern72 { length },
        KernelKind::CubicQuintic { crossover } => KernelKind::CubicQuintic { crossover }
    );
}

#[inline(always)]
fn approach_one(kernel: KernelKind, u: &Point, centres: &[[f64; BLOCK]], near: &mut Near) {
    let mut square = [0.0; BLOCK];
    for ((centres, u), d) in centres.iter().zip(u).zip(&mut near[3..]) {
        for k in 0..BLOCK {
            d[k] = u - centres[k];
            square[k] += d[k] * d[k];
        }
    }
    for k in 0..BLOCK {
        let [g, a, b] = kernel.derivatives(square[k]);
        (near[0][k], near[1][k], near[2][k]) = (g, a, b);
    }
}

/// Terms of a tail at most: 1, every input, every product of two.
const MAX_TERMS: usize = 1 + MAX_INPUTS + MAX_INPUTS * (MAX_INPUTS + 1) / 2;

/// Slices for the derivatives with respect to each scaled input; those beyond the inputs in use stay unchanged.
pub(crate) type Gradient<'a> = [&'a mut [f64]; MAX_INPUTS];

/// A tail over `M x`.
pub(crate) struct Polynomial<'a> {
    pub tail: Tail,
    pub metric: &'a Metric,
    pub dimensions: usize,
    /// `terms x outputs`.
    pub weights: &'a [f64],
}

impl Polynomial<'_> {
    /// Adds value and, if `by` is given, derivatives of every output at `u = M x`. Cost: one product per
    /// term and output, with derivatives up to twice `dimensions` more.
    pub(crate) fn add(&self, u: &Point, value: &mut [f64], by: Option<Gradient<'_>>) {
        add(self, u, value, by);
    }

    #[inline(always)]
    fn add_plain(&self, u: &Point, value: &mut [f64], mut by: Option<Gradient<'_>>) {
        let (mut terms, mut count) = ([(0.0, [0.0; MAX_INPUTS]); MAX_TERMS], 0);
        self.tail.each_term(self.dimensions, u, |term, slopes| {
            terms[count] = (term, self.metric.pull_back(slopes));
            count += 1;
        });
        let outputs = value.len();
        // Eight outputs stay in registers in the loop over the terms.
        for first in (0..outputs).step_by(BLOCK) {
            let here = first..outputs.min(first + BLOCK);
            let (mut sums, mut slope_sums) = (block(&value[here.clone()]), [[0.0; BLOCK]; MAX_INPUTS]);
            if let Some(by) = &by {
                for j in 0..self.dimensions {
                    slope_sums[j] = block(&by[j][here.clone()]);
                }
            }
            for ((term, slopes), w) in terms[..count].iter().zip(self.weights.chunks_exact(outputs)) {
                let w = block(&w[here.clone()]);
                add_times(&mut sums, &w, *term);
                if by.is_some() {
                    for j in 0..self.dimensions {
                        if slopes[j] != 0.0 {
                            add_times(&mut slope_sums[j], &w, slopes[j]);
                        }
                    }
                }
            }
            value[here.clone()].copy_from_slice(&sums[..here.len()]);
            if let Some(by) = &mut by {
                for j in 0..self.dimensions {
                    by[j][here.clone()].copy_from_slice(&slope_sums[j][..here.len()]);
                }
            }
        }
    }
}

with_widest_vectors! {
    fn add(tail: &Polynomial<'_>, u: &Point, value: &mut [f64], by: Option<Gradient<'_>>) = Polynomial::add_plain;
}

/// Up to eight values, followed by zeros.
#[inline(always)]
fn block(values: &[f64]) -> [f64; BLOCK] {
    let mut out = [0.0; BLOCK];
    match values.try_into() {
        Ok(whole) => out = whole,
        Err(_) => out[..values.len()].copy_from_slice(values),
    }
    out
}

#[inline(always)]
fn add_times(to: &mut [f64; BLOCK], from: &[f64; BLOCK], factor: f64) {
    for (to, from) in to.iter_mut().zip(from) {
        *to += from * factor;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inputs::MAX_INPUTS;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn kernel_values_agree_on_all_instruction_sets(
            u in proptest::array::uniform8(-2.0..2.0_f64),
            places in proptest::collection::vec(proptest::array::uniform8(-2.0..2.0_f64), 1..12),
            dimensions in 1..=MAX_INPUTS,
            kernel in 0..7_usize,
        ) {
            let kernel = [
                KernelKind::Linear,
                KernelKind::ThinPlate,
                KernelKind::Cubic,
                KernelKind::Quintic,
                KernelKind::Gaussian { shape: 1.5 },
                KernelKind::Matern72 { length: 0.7 },
                KernelKind::CubicQuintic { crossover: 0.4 },
            ][kernel];
            let group = |centres: &[[f64; 8]]| -> Vec<[f64; BLOCK]> {
                // The state itself in the rows that are left.
                (0..dimensions).map(|j| std::array::from_fn(|k| centres.get(k).map_or(u[j], |at| at[j]))).collect()
            };
            let centres: Vec<[f64; BLOCK]> = places.chunks(BLOCK).flat_map(group).collect();
            let mut near = vec![[[f64::NAN; BLOCK]; 3 + MAX_INPUTS]; places.len().div_ceil(BLOCK)];
            approach(kernel, &u, dimensions, &centres, &mut near);
            for k in 0..near.len() * BLOCK {
                let (block_of_eight, lane) = (&near[k / BLOCK], k % BLOCK);
                let mut square = 0.0;
                for j in 0..dimensions {
                    let d = u[j] - places.get(k).map_or(u[j], |at| at[j]);
                    prop_assert_eq!(block_of_eight[3 + j][lane].to_bits(), d.to_bits());
                    square += d * d;
                }
                for (row, wanted) in kernel.derivatives(square).into_iter().enumerate() {
                    prop_assert_eq!(block_of_eight[row][lane].to_bits(), wanted.to_bits());
                }
            }
        }
    }
}
