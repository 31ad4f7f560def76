//! A trained interpolant: kernel sums with a polynomial tail, over scaled inputs, with analytic gradients.
//!
//! `a(x) = sum_k w_k g(|M (x - x_k)|) + tail(M x)` (Eqs. 8-14 with scaling and tail), where `x` is scaled to the training
//! range and the metric `M` stretches and shears it (for a Gaussian process by its lengths). One kernel vector serves all
//! outputs. Fitted to derivatives as well, it has further terms `v_kj d/dx_kj g(|M (x - x_k)|)`, one for each ([`Slope`]).

use crate::config::{KernelKind, Tail};
use crate::inputs::{MAX_INPUTS, Point};
use crate::kernel::weigh::weigh;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// How distances between scaled inputs are taken: `M x = (s0 (x0 + shear x1), s1 x1, s2 x2, ...)`. Contact features run
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
    /// Distances as they are.
    pub const IDENTITY: Self = Self { scale: [1.0; MAX_INPUTS], shear: 0.0 };

    /// The same with another factor on one input.
    pub(crate) fn stretched(mut self, input: usize, factor: f64) -> Self {
        self.scale[input] = factor;
        self
    }

    /// `M x`.
    pub(crate) fn apply(&self, x: &Point) -> Point {
        let mut u = *x;
        u[0] += self.shear * x[1];
        u.iter_mut().zip(&self.scale).for_each(|(u, s)| *u *= s);
        u
    }

    /// `M^T g`: a gradient over `M x` as a gradient over `x`.
    pub(crate) fn pull_back<const D: usize>(&self, mut g: [f64; D]) -> [f64; D] {
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
    /// Kernel.
    pub kernel: KernelKind,
    /// Polynomial tail.
    pub tail: Tail,
    /// Inputs, 1 to [`MAX_INPUTS`].
    pub dimensions: usize,
    /// How distances are taken.
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
    /// Derivatives that it was fitted to, ordered by centre. The model file keeps them apart (`model/further.rs`).
    #[serde(skip)]
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

/// Quantities that are summed in one pass over the weights.
const PASS: usize = 3;
/// Passes for the value and the slopes along all inputs.
const PASSES: usize = (1 + MAX_INPUTS).div_ceil(PASS);

/// Reusable kernel values of one state: no allocation after construction.
#[derive(Clone, Debug, Default)]
pub(crate) struct KernelScratch {
    /// By pass and centre: (value, slope 0, slope 1), (slope 2, slope 3, slope 4), ...
    factors: [Vec<[f64; PASS]>; PASSES],
}

/// Slices that take the derivatives by each scaled input: as many as [`gradient_rows`] says, the rest empty.
pub(crate) type Gradient<'a> = [&'a mut [f64]; MAX_INPUTS];

/// Derivatives that are computed together with those over `dimensions` inputs: whole passes.
pub(crate) fn gradient_rows(dimensions: usize) -> usize {
    (1 + dimensions).next_multiple_of(PASS) - 1
}

impl KernelScratch {
    /// Makes room for interpolants of up to `centres` terms over `dimensions` inputs.
    pub fn reserve(&mut self, dimensions: usize, centres: usize) {
        for factors in self.factors.iter_mut().take((1 + dimensions).div_ceil(PASS)) {
            if factors.len() < centres {
                factors.resize(centres, [0.0; PASS]);
            }
        }
    }

    /// Value and gradient of a term.
    fn put<const D: usize>(&mut self, term: usize, value: f64, gradient: &[f64; D]) {
        let factor = |i: usize| if i == 0 { value } else { gradient.get(i - 1).copied().unwrap_or(0.0) };
        for (pass, factors) in self.factors.iter_mut().enumerate().take((1 + D).div_ceil(PASS)) {
            factors[term] = std::array::from_fn(|i| factor(PASS * pass + i));
        }
    }
}

/// First and second derivatives of a kernel over `D` scaled inputs at one distance from a centre.
pub(crate) struct Curvature<'a, const D: usize> {
    metric: &'a Metric,
    /// `g'(r) / r` and `(g'(r) / r)' / r`.
    over_r: f64,
    second: f64,
    /// `M^T M (x - x_k)`.
    pulled: [f64; D],
}

impl<'a, const D: usize> Curvature<'a, D> {
    /// At `d = M (x - x_k)`.
    pub(crate) fn at(kernel: KernelKind, metric: &'a Metric, d: &[f64; D]) -> Self {
        let r2 = d.iter().map(|d| d * d).sum();
        let pulled = metric.pull_back(*d);
        Self { metric, over_r: kernel.radial(r2).1, second: kernel.second(r2), pulled }
    }

    /// The term of a derivative by input `axis` of the centre, and its gradient: `-d g / d x_axis` and the derivatives of
    /// that.
    pub(crate) fn row(&self, axis: usize) -> (f64, [f64; D]) {
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

    /// Value and gradient over scaled inputs of every output at `x`. Cost `O(centres x (1 + outputs (1 + dimensions)))`,
    /// no allocation.
    pub(crate) fn evaluate(
        &self,
        x: &Point,
        scratch: &mut KernelScratch,
        value: &mut [f64],
        gradient: Gradient<'_>,
    ) {
        self.kernel_values(x, scratch);
        self.combine(x, scratch, value, gradient);
    }

    /// Whether the kernel values of `other` are this interpolant's too: same kernel over the same centres.
    pub(crate) fn shares_kernel_with(&self, other: &Self) -> bool {
        self.kernel == other.kernel
            && self.metric == other.metric
            && self.centres == other.centres
            && self.slopes == other.slopes
    }

    /// Kernel values and their gradients at `x`, into `scratch`.
    pub(crate) fn kernel_values(&self, x: &Point, scratch: &mut KernelScratch) {
        match self.dimensions {
            1 => self.kernel_values_over::<1>(x, scratch),
            2 => self.kernel_values_over::<2>(x, scratch),
            3 => self.kernel_values_over::<3>(x, scratch),
            4 => self.kernel_values_over::<4>(x, scratch),
            5 => self.kernel_values_over::<5>(x, scratch),
            6 => self.kernel_values_over::<6>(x, scratch),
            7 => self.kernel_values_over::<7>(x, scratch),
            _ => self.kernel_values_over::<8>(x, scratch),
        }
    }

    fn kernel_values_over<const D: usize>(&self, x: &Point, scratch: &mut KernelScratch) {
        let u = self.metric.apply(x);
        for (k, centre) in self.centres.as_chunks::<D>().0.iter().enumerate() {
            let d: [f64; D] = std::array::from_fn(|i| u[i] - centre[i]);
            let (phi, over_r) = self.kernel.radial(d.iter().map(|d| d * d).sum());
            let slope = self.metric.pull_back(d.map(|d| over_r * d));
            scratch.put(k, phi, &slope);
        }
        let (mut rows, centres) = (self.slopes.iter().enumerate().peekable(), self.centre_count());
        while let Some((_, first)) = rows.peek().copied() {
            let centre = &self.centres.as_chunks::<D>().0[first.centre as usize];
            let d: [f64; D] = std::array::from_fn(|i| u[i] - centre[i]);
            let curvature = Curvature::at(self.kernel, &self.metric, &d);
            while let Some((j, slope)) = rows.next_if(|(_, slope)| slope.centre == first.centre) {
                let (value, gradient) = curvature.row(slope.axis as usize);
                scratch.put(centres + j, value, &gradient);
            }
        }
    }

    /// Weighs the kernel values in `scratch` and adds the tail.
    pub(crate) fn combine(
        &self,
        x: &Point,
        scratch: &KernelScratch,
        value: &mut [f64],
        gradient: Gradient<'_>,
    ) {
        if self.outputs == 0 {
            return; // a constant field has no modes
        }
        let [d0, d1, d2, d3, d4, d5, d6, d7] = gradient;
        let rows = [
            [&mut *value, &mut *d0, &mut *d1],
            [&mut *d2, &mut *d3, &mut *d4],
            [&mut *d5, &mut *d6, &mut *d7],
        ];
        let passes = (1 + self.dimensions).div_ceil(PASS);
        for (factors, rows) in scratch.factors.iter().zip(rows).take(passes) {
            weigh(&self.weights, factors, rows);
        }
        let mut rows = [d0, d1, d2, d3, d4, d5, d6, d7];
        let u = self.metric.apply(x);
        let mut weights = self.tail_weights.chunks_exact(self.outputs);
        self.tail.each_term(self.dimensions, &u, |term, slopes| {
            let Some(w) = weights.next() else { return };
            let slopes = self.metric.pull_back(slopes);
            value.iter_mut().zip(w).for_each(|(v, w)| *v += w * term);
            for (row, slope) in rows.iter_mut().zip(slopes).take(self.dimensions) {
                row.iter_mut().zip(w).for_each(|(d, w)| *d += w * slope);
            }
        });
    }

    /// Values only, allocated: for training.
    pub(crate) fn values_at(&self, x: &Point) -> Vec<f64> {
        self.all_at(x).0
    }

    /// Derivatives by each scaled input, allocated: for training.
    pub(crate) fn gradient_at(&self, x: &Point) -> Vec<Vec<f64>> {
        self.all_at(x).1.into_iter().take(self.dimensions).collect()
    }

    fn all_at(&self, x: &Point) -> (Vec<f64>, [Vec<f64>; MAX_INPUTS]) {
        let mut scratch = KernelScratch::default();
        scratch.reserve(self.dimensions, self.terms());
        let mut value = vec![0.0; self.outputs];
        let mut rows: [Vec<f64>; MAX_INPUTS] = std::array::from_fn(|_| vec![0.0; self.outputs]);
        self.evaluate(x, &mut scratch, &mut value, rows.each_mut().map(Vec::as_mut_slice));
        (value, rows)
    }
}
