//! Sums over the cases around a state, weighted by `1 / (|x - x_j|^2 + h^2)^2`, eight side by side. Products and sums are rounded separately:
//! results are bit-identical on all instruction sets.

use super::isa::with_widest_vectors;
use super::weigh::BLOCK;
use crate::inputs::Point;

/// Cases and the values to sum over them.
pub(crate) struct Around<'a> {
    /// `dimensions x cases`.
    pub inputs: &'a [f64],
    /// Three values for each case.
    pub values: &'a [Vec<f64>; 3],
    /// `h^2`.
    pub square: f64,
}

impl Around<'_> {
    /// The sum of the weights, and of the three values times their weights. `O(cases)`.
    pub(crate) fn sums(&self, x: &Point) -> [f64; 4] {
        let mut sums = [[0.0; BLOCK]; 4];
        add_up(self, x, &mut sums);
        sums.map(|lanes| lanes.iter().sum())
    }

    #[inline(always)]
    fn add_up_plain(&self, x: &Point, sums: &mut [[f64; BLOCK]; 4]) {
        let cases = self.values[0].len();
        let mut first = 0;
        while first < cases {
            let mut squares = [self.square; BLOCK];
            for (axis, x) in self.inputs.chunks_exact(cases).zip(x) {
                let near = eight(axis, first, f64::INFINITY);
                for k in 0..BLOCK {
                    squares[k] += (near[k] - x) * (near[k] - x);
                }
            }
            let mut weights = [0.0; BLOCK];
            for k in 0..BLOCK {
                weights[k] = 1.0 / (squares[k] * squares[k]);
                sums[0][k] += weights[k];
            }
            for (sum, values) in sums[1..].iter_mut().zip(self.values) {
                let values = eight(values, first, 0.0);
                for k in 0..BLOCK {
                    sum[k] += weights[k] * values[k];
                }
            }
            first += BLOCK;
        }
    }
}

with_widest_vectors! {
    fn add_up(around: &Around<'_>, x: &Point, sums: &mut [[f64; BLOCK]; 4]) = Around::add_up_plain;
}

/// Eight values from `first` on, followed by `beyond` where there are less: a case infinitely far has no weight.
#[inline(always)]
fn eight(values: &[f64], first: usize, beyond: f64) -> [f64; BLOCK] {
    let mut out = [beyond; BLOCK];
    match values[first..].first_chunk() {
        Some(whole) => out = *whole,
        None => out[..values.len() - first].copy_from_slice(&values[first..]),
    }
    out
}
