//! A trained interpolant: kernel sums with a polynomial tail, over scaled inputs, with analytic gradients.
//!
//! `a(x) = sum_k w_k g(|M (x - x_k)|) + tail(M x)` (Eqs. 8-14 with scaling and tail), where `x` is scaled to the training
//! range and the metric `M` stretches and shears it (for a Gaussian process by its lengths). One kernel vector serves all
//! outputs. Fitted to derivatives as well, it has further terms `v_kj d/dx_kj g(|M (x - x_k)|)`, one for each ([`Slope`]).

use crate::inputs::{MAX_INPUTS, Point};
use crate::radial::{KernelKind, Tail};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Metric of distances between scaled inputs: `M x = (s0 (x0 + shear x1), s1 x1, s2 x2, ...)`. Contact features run
/// aslant over pressure and gap (what counts is how far the pressure is above the onset), so the shear pays.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Metric {
    /// Factors on the inputs after shearing; 1 for those not in use.
    #[serde(serialize_with = "write_scale", deserialize_with = "read_scale")]
    pub scale: [f64; MAX_INPUTS],
    /// Share of the second scaled input added to the first.
    pub shear: f64,
}

/// Without the ones behind the last factor, but two at least.
fn write_scale<S: Serializer>(scale: &[f64; MAX_INPUTS], to: S) -> Result<S::Ok, S::Error> {
    let used = scale.iter().rposition(|s| *s != 1.0).map_or(0, |last| last + 1);
    scale[..used.max(2)].serialize(to)
}

fn read_scale<'de, D: Deserializer<'de>>(from: D) -> Result<[f64; MAX_INPUTS], D::Error> {
    let written = Vec::<f64>::deserialize(from)?;
    let mut scale = [1.0; MAX_INPUTS];
    scale.iter_mut().zip(written).for_each(|(s, w)| *s = w);
    Ok(scale)
}

impl Metric {
    /// Plain distances.
    pub const IDENTITY: Self = Self { scale: [1.0; MAX_INPUTS], shear: 0.0 };

    /// The same with another factor on one input.
    pub fn stretched(mut self, input: usize, factor: f64) -> Self {
        self.scale[input] = factor;
        self
    }

    /// `M x`.
    pub fn apply(&self, x: &Point) -> Point {
        let mut u = *x;
        u[0] += self.shear * x[1];
        u.iter_mut().zip(&self.scale).for_each(|(u, s)| *u *= s);
        u
    }

    /// `M^T g`: a gradient over `M x` as a gradient over `x`.
    pub fn pull_back<const D: usize>(&self, mut g: [f64; D]) -> [f64; D] {
        g.iter_mut().zip(&self.scale).for_each(|(g, s)| *g *= s);
        if D > 1 {
            g[1] += self.shear * g[0];
        }
        g
    }
}

/// A trained interpolant of `outputs` functions over `dimensions` scaled inputs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Interpolant {
    /// Radial function about each centre.
    #[serde(with = "crate::radial::numbered")]
    pub kernel: KernelKind,
    /// Polynomial that is added to the sum over the centres.
    pub tail: Tail,
    /// Inputs, 1 to [`MAX_INPUTS`].
    pub dimensions: usize,
    /// Metric of the distances.
    pub metric: Metric,
    /// `centres x dimensions`: `M x_k`, all inputs of a centre together.
    pub centres: Vec<f64>,
    /// `(centres + slopes) x outputs`, all outputs of a centre or slope together.
    pub weights: Vec<f64>,
    /// `tail terms x outputs`.
    pub tail_weights: Vec<f64>,
    /// Number of outputs.
    pub outputs: usize,
    /// Smoothing added to the diagonal, relative to the kernel matrix's scale.
    pub smoothing: f64,
    /// 2-norm condition number of the system that was solved.
    pub condition: f64,
    /// Relative residual of the solution.
    pub residual: f64,
    /// Derivatives that it was fitted to, ordered by centre.
    pub slopes: Vec<Slope>,
}

/// A derivative that an interpolant was fitted to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Slope {
    /// Index of the centre.
    pub centre: u32,
    /// Scaled input that is differentiated by.
    pub axis: u32,
}

/// First and second derivatives of a kernel over `D` scaled inputs at one distance from a centre.
pub struct Curvature<'a, const D: usize> {
    metric: &'a Metric,
    /// `g'(r) / r` and `(g'(r) / r)' / r`.
    over_r: f64,
    second: f64,
    /// `M^T M (x - x_k)`.
    pulled: [f64; D],
}

impl<'a, const D: usize> Curvature<'a, D> {
    /// At `d = M (x - x_k)`.
    pub fn at(kernel: KernelKind, metric: &'a Metric, d: &[f64; D]) -> Self {
        let r2 = d.iter().map(|d| d * d).sum();
        let [_, over_r, second] = kernel.derivatives(r2);
        Self { metric, over_r, second, pulled: metric.pull_back(*d) }
    }

    /// Term of a derivative with respect to input `axis` of the centre, and its gradient: `-d g / d x_axis` and the derivatives of
    /// that.
    pub fn row(&self, axis: usize) -> (f64, [f64; D]) {
        let mut column = [0.0; D]; // M e_axis, then M^T M e_axis
        column[axis] = self.metric.scale[axis];
        if axis == 1 {
            column[0] = self.metric.scale[0] * self.metric.shear;
        }
        let mut gradient = self.metric.pull_back(column);
        for (g, pulled) in gradient.iter_mut().zip(&self.pulled) {
            *g = -self.over_r * *g - self.second * self.pulled[axis] * pulled;
        }
        (-self.over_r * self.pulled[axis], gradient)
    }
}

impl Interpolant {
    /// Number of centres.
    pub fn centre_count(&self) -> usize {
        self.centres.len() / self.dimensions.max(1)
    }

    /// Number of kernel terms: one a centre, one a slope.
    pub(crate) fn terms(&self) -> usize {
        self.centre_count() + self.slopes.len()
    }

    /// True if the kernel values of `other` are equal: same kernel and tail over the same centres.
    pub fn shares_kernel_with(&self, other: &Self) -> bool {
        self.kernel == other.kernel
            && self.tail == other.tail
            && self.metric == other.metric
            && self.centres == other.centres
            && self.slopes == other.slopes
    }
}
