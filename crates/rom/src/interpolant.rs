//! A trained interpolant: kernel sums with a polynomial tail, over scaled inputs, with analytic gradients.
//!
//! `a(x) = sum_k w_k g(|s (x - x_k)|) + tail(x)` (Eqs. 8-14 with scaling and tail), where `s` scales each input to the
//! training range (and, for a Gaussian process, by its length). One kernel vector serves all outputs.

use crate::config::{KernelKind, Tail};
use serde::{Deserialize, Serialize};

/// Inputs of a regime: which of (pressure, gap) it takes, and their ranges.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InputMap {
    /// Axes in order.
    pub axes: Vec<InputAxis>,
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

/// A trained interpolant of `outputs` functions over `dimensions` scaled inputs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Interpolant {
    /// Kernel.
    pub kernel: KernelKind,
    /// Polynomial tail.
    pub tail: Tail,
    /// Inputs, 1 or 2.
    pub dimensions: usize,
    /// Factor on each scaled input before distances are taken (1 unless lengths were fitted).
    pub metric: [f64; 2],
    /// Centres, scaled by `metric`.
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
