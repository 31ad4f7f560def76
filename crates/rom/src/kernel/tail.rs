//! Polynomial tails of interpolants. Products and sums are rounded separately: results are bit-identical on all instruction sets.

use super::isa::with_widest_vectors;
use super::weigh::BLOCK;
use crate::inputs::{MAX_INPUTS, Point};
use crate::interpolant::Metric;
use crate::radial::Tail;

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
