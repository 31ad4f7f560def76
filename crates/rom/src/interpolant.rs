//! A trained interpolant: kernel sums with a polynomial tail, over scaled inputs, with analytic gradients.
//!
//! `a(x) = sum_k w_k g(|M (x - x_k)|) + tail(M x)` (Eqs. 8-14 with scaling and tail), where `x` is scaled to the training
//! range and the metric `M` stretches and shears it (for a Gaussian process by its lengths). One kernel vector serves all
//! outputs.

use crate::config::{KernelKind, Tail};
use crate::kernel::weigh::{Kernels, weigh};
use serde::{Deserialize, Serialize};

/// Inputs of a regime: which of (pressure, gap) it takes, and their ranges.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InputMap {
    /// Axes in order.
    pub axes: Vec<InputAxis>,
    /// The gap all samples shared, where it is therefore no input.
    pub constant_gap_mm: Option<f64>,
}

/// One input and the range it was sampled over.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct InputAxis {
    /// Which reading.
    pub quantity: Quantity,
    /// Smallest training value.
    pub min: f64,
    /// Largest training value.
    pub max: f64,
}

/// A reading that can be an input.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Quantity {
    /// Cavity pressure in MPa.
    PressureMpa,
    /// Gap in mm.
    GapMm,
}

impl InputMap {
    /// Number of inputs, 1 or 2.
    pub fn dimensions(&self) -> usize {
        self.axes.len()
    }

    /// Scales `(pressure, gap)` to [0, 1] over the training range; unused entries are 0.
    pub fn scale(&self, pressure_mpa: f64, gap_mm: f64) -> [f64; 2] {
        let mut x = [0.0; 2];
        for (x, axis) in x.iter_mut().zip(&self.axes) {
            let value = match axis.quantity {
                Quantity::PressureMpa => pressure_mpa,
                Quantity::GapMm => gap_mm,
            };
            *x = (value - axis.min) / (axis.max - axis.min);
        }
        x
    }

    /// How far a gap lies from the one gap all samples shared, as a share of it; 0 when the gap is an input.
    pub fn off_constant(&self, gap_mm: f64) -> f64 {
        match self.constant_gap_mm {
            Some(constant) => (gap_mm - constant).abs() / constant.abs().max(1.0),
            None => 0.0,
        }
    }

    /// Turns a gradient over scaled inputs into `(d/dP per MPa, d/dgap per mm)`.
    pub fn unscale_gradient(&self, gradient: [f64; 2]) -> (f64, f64) {
        let mut out = (0.0, 0.0);
        for (g, axis) in gradient.iter().zip(&self.axes) {
            let slope = g / (axis.max - axis.min);
            match axis.quantity {
                Quantity::PressureMpa => out.0 = slope,
                Quantity::GapMm => out.1 = slope,
            }
        }
        out
    }
}

/// How distances between scaled inputs are taken: `M x = (s0 (x0 + shear x1), s1 x1)`. Contact features run aslant over
/// pressure and gap (what counts is how far the pressure is above the onset), so the shear pays.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Metric {
    /// Factors on the two inputs after shearing.
    pub scale: [f64; 2],
    /// Share of the second scaled input added to the first.
    pub shear: f64,
}

impl Metric {
    /// Distances as they are.
    pub const IDENTITY: Self = Self { scale: [1.0, 1.0], shear: 0.0 };

    /// `M x`.
    pub fn apply(&self, x: [f64; 2]) -> [f64; 2] {
        [self.scale[0] * (x[0] + self.shear * x[1]), self.scale[1] * x[1]]
    }

    /// `M^T g`: a gradient over `M x` as a gradient over `x`.
    fn pull_back(&self, g: [f64; 2]) -> [f64; 2] {
        let first = self.scale[0] * g[0];
        [first, self.scale[1] * g[1] + self.shear * first]
    }
}

impl From<[f64; 2]> for Metric {
    fn from(scale: [f64; 2]) -> Self {
        Self { scale, shear: 0.0 }
    }
}

/// A trained interpolant of `outputs` functions over `dimensions` scaled inputs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Interpolant {
    /// Kernel.
    pub kernel: KernelKind,
    /// Polynomial tail.
    pub tail: Tail,
    /// Inputs, 1 or 2.
    pub dimensions: usize,
    /// How distances are taken.
    pub metric: Metric,
    /// Centres, `M x_k`.
    pub centres: Vec<[f64; 2]>,
    /// `centres x outputs`, all outputs of a centre together.
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
}

/// Reusable kernel values of one query: no allocation after construction.
#[derive(Clone, Debug, Default)]
pub struct KernelScratch {
    value: Vec<f64>,
    slope: Vec<[f64; 2]>,
}

impl KernelScratch {
    /// Room for interpolants of up to `centres` centres.
    pub fn new(centres: usize) -> Self {
        Self { value: vec![0.0; centres], slope: vec![[0.0; 2]; centres] }
    }
}

impl Interpolant {
    /// Value and gradient over scaled inputs of every output at `x`: `value[k]`, `(dx0[k], dx1[k])`.
    ///
    /// Cost `O(centres x (1 + 3 outputs))`, no allocation.
    ///
    /// # Panics
    /// When a slice is not `outputs` long or `scratch` is too small.
    pub fn evaluate(
        &self,
        x: [f64; 2],
        scratch: &mut KernelScratch,
        value: &mut [f64],
        dx0: &mut [f64],
        dx1: &mut [f64],
    ) {
        self.kernel_values(x, scratch);
        self.combine(x, scratch, value, dx0, dx1);
    }

    /// Whether the kernel values of `other` are this interpolant's too: same kernel over the same centres.
    pub fn shares_kernel_with(&self, other: &Self) -> bool {
        self.kernel == other.kernel && self.metric == other.metric && self.centres == other.centres
    }

    /// Kernel values and their gradients at `x`, into `scratch`.
    pub(crate) fn kernel_values(&self, x: [f64; 2], scratch: &mut KernelScratch) {
        let u = self.metric.apply(x);
        let n = self.centres.len();
        let (g, dg) = (&mut scratch.value[..n], &mut scratch.slope[..n]);
        for ((centre, g), dg) in self.centres.iter().zip(g.iter_mut()).zip(dg.iter_mut()) {
            let d = [u[0] - centre[0], u[1] - centre[1]];
            let (phi, over_r) = self.kernel.radial(d[0] * d[0] + d[1] * d[1]);
            *g = phi;
            *dg = self.metric.pull_back([over_r * d[0], over_r * d[1]]);
        }
    }

    /// Weighs the kernel values in `scratch` and adds the tail.
    pub(crate) fn combine(
        &self,
        x: [f64; 2],
        scratch: &KernelScratch,
        value: &mut [f64],
        dx0: &mut [f64],
        dx1: &mut [f64],
    ) {
        if self.outputs == 0 {
            return; // a constant field has no modes
        }
        let kernels = Kernels { weights: &self.weights, values: &scratch.value, slopes: &scratch.slope };
        weigh(kernels, [&mut *value, &mut *dx0, &mut *dx1]);
        let u = self.metric.apply(x);
        let terms = self.tail.terms(self.dimensions);
        let (t, dt) = (self.tail.values(self.dimensions, u), self.tail.gradients(self.dimensions, u));
        for (i, w) in self.tail_weights.chunks_exact(self.outputs).enumerate().take(terms) {
            accumulate(w, t[i], self.metric.pull_back(dt[i]), value, dx0, dx1);
        }
    }

    /// Values only, allocated: for training and reports.
    pub fn values_at(&self, x: [f64; 2]) -> Vec<f64> {
        let mut out = [vec![0.0; self.outputs], vec![0.0; self.outputs], vec![0.0; self.outputs]];
        let [value, dx0, dx1] = &mut out;
        self.evaluate(x, &mut KernelScratch::new(self.centres.len()), value, dx0, dx1);
        std::mem::take(value)
    }
}

fn accumulate(w: &[f64], g: f64, dg: [f64; 2], value: &mut [f64], dx0: &mut [f64], dx1: &mut [f64]) {
    for (((w, v), d0), d1) in w.iter().zip(value).zip(dx0).zip(dx1) {
        *v += w * g;
        *d0 += w * dg[0];
        *d1 += w * dg[1];
    }
}
