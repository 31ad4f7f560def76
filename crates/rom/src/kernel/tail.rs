//! Polynomial tails of interpolants. Products and sums are rounded apart: every instruction set gives the same bits.

use super::isa::with_widest_vectors;
use crate::config::Tail;
use crate::inputs::{MAX_INPUTS, Point};
use crate::interpolant::Metric;

/// Terms of a tail at most: 1, every input, every product of two.
const MAX_TERMS: usize = 1 + MAX_INPUTS + MAX_INPUTS * (MAX_INPUTS + 1) / 2;

/// Slices that take the derivatives by each scaled input; those beyond the inputs in use stay as they are.
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
    /// Adds value and, where there are slices for them, derivatives by each scaled input of every output at `u = M x`. Cost: a product a
    /// term and output, with derivatives up to twice `dimensions` more.
    pub(crate) fn add(&self, u: &Point, value: &mut [f64], by: Option<Gradient<'_>>) {
        add(self, u, value, by);
    }

    #[inline(always)]
    fn add_plain(&self, u: &Point, value: &mut [f64], mut by: Option<Gradient<'_>>) {
        let (mut terms, mut count) = ([(0.0, [0.0; MAX_INPUTS]); MAX_TERMS], 0);
        self.tail.each_term(self.dimensions, u, |term, slopes| {
            terms[count] = (term, slopes);
            count += 1;
        });
        for ((term, slopes), w) in terms[..count].iter().zip(self.weights.chunks_exact(value.len().max(1))) {
            add_times(value, w, *term);
            let Some(by) = &mut by else { continue };
            let slopes = self.metric.pull_back(*slopes);
            for j in 0..self.dimensions {
                if slopes[j] != 0.0 {
                    add_times(by[j], w, slopes[j]);
                }
            }
        }
    }
}

with_widest_vectors! {
    fn add(tail: &Polynomial<'_>, u: &Point, value: &mut [f64], by: Option<Gradient<'_>>) = Polynomial::add_plain;
}

#[inline(always)]
fn add_times(to: &mut [f64], from: &[f64], factor: f64) {
    for (to, from) in to.iter_mut().zip(from) {
        *to += from * factor;
    }
}
