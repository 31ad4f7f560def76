//! Polynomial tails of interpolants. Products and sums are rounded apart: every instruction set gives the same bits.

use super::isa::Isa;
use crate::config::Tail;
use crate::inputs::{MAX_INPUTS, Point};
use crate::interpolant::Metric;

/// Terms of a tail at most: 1, every input, every product of two.
const MAX_TERMS: usize = 1 + MAX_INPUTS + MAX_INPUTS * (MAX_INPUTS + 1) / 2;

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
    pub(crate) fn add(&self, u: &Point, value: &mut [f64], by: Option<[&mut [f64]; MAX_INPUTS]>) {
        match Isa::detect() {
            #[cfg(target_arch = "x86_64")]
            // SAFETY: detected just now.
            Isa::Avx512 => unsafe { self.add_avx512(u, value, by) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: detected just now.
            Isa::Avx2 => unsafe { self.add_avx2(u, value, by) },
            _ => self.add_plain(u, value, by),
        }
    }

    /// # Safety
    /// The processor has AVX-512 F.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f")]
    unsafe fn add_avx512(&self, u: &Point, value: &mut [f64], by: Option<[&mut [f64]; MAX_INPUTS]>) {
        self.add_plain(u, value, by);
    }

    /// # Safety
    /// The processor has AVX2.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    unsafe fn add_avx2(&self, u: &Point, value: &mut [f64], by: Option<[&mut [f64]; MAX_INPUTS]>) {
        self.add_plain(u, value, by);
    }

    /// Plain Rust that the compiler makes vectors of.
    #[inline(always)]
    fn add_plain(&self, u: &Point, value: &mut [f64], mut by: Option<[&mut [f64]; MAX_INPUTS]>) {
        let (mut terms, mut count) = ([(0.0, [0.0; MAX_INPUTS]); MAX_TERMS], 0);
        self.tail.each_term(self.dimensions, u, |term, slopes| {
            terms[count] = (term, slopes);
            count += 1;
        });
        // No closures from here on: they do not have the instruction set of the function that they stand in.
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

#[inline(always)]
fn add_times(to: &mut [f64], from: &[f64], factor: f64) {
    for (to, from) in to.iter_mut().zip(from) {
        *to += from * factor;
    }
}
