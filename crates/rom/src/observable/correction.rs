//! Measured difference of an observable from the finite elements, smooth over the inputs.
//!
//! ```text
//! offset(x)     = sum_k w_k g(|x - c_k|)      g and R: crate::difference
//! share(x)      = max_k g(|x - c_k|)          1 at a measured state, 0 farther than R from all of them
//! half-width    = share q + (1 - share) sqrt(h^2 + d^2)
//! ```
//!
//! `q` is the 90 % quantile of the errors on parts of the recordings that were left out, `d` that of the difference itself, `h` the model's
//! half-width: where nothing was measured, the offset is 0 and the model may be as far off as at the measured inputs.

use crate::difference::{terms, with_slopes};
use crate::evaluation::Evaluation;
use crate::inputs::{InputMap, Inputs, MAX_INPUTS, Point};
use crate::snapshots::RegimeKind;
use serde::{Deserialize, Serialize};

/// Difference of one observable in one regime.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Correction {
    /// The regime whose values it changes.
    pub regime: RegimeKind,
    /// Inputs of the regime.
    pub inputs: InputMap,
    /// Distance `R` over scaled inputs from which on the offset is 0.
    pub reach: f64,
    /// Centres `c`.
    pub centres: Vec<Point>,
    /// Weights `w`, in the observable's unit.
    pub weights: Vec<f64>,
    /// Half-width at a measured state, `q`.
    pub residual: f64,
    /// Half-width of the difference itself, `d`, which counts where nothing was measured.
    pub difference: f64,
}

impl Correction {
    /// True if the numbers can be evaluated.
    pub(super) fn is_sound(&self) -> bool {
        let finite = self.centres.as_flattened().iter().chain(&self.weights).all(|v| v.is_finite());
        finite && self.centres.len() == self.weights.len() && self.reach > 0.0
    }

    /// Offset and share at a state. Allocates nothing.
    pub fn at(&self, inputs: &Inputs) -> (f64, f64) {
        self.at_scaled(&self.inputs.scale(inputs))
    }

    /// [`Self::at`] at scaled inputs.
    pub fn at_scaled(&self, x: &Point) -> (f64, f64) {
        let values = || terms(&self.centres, self.reach, x);
        let offset = values().zip(&self.weights).map(|(g, w)| g * w).sum();
        (offset, values().fold(0.0, f64::max))
    }

    /// Derivatives of the offset with respect to each input.
    pub(super) fn gradient(&self, evaluation: &Evaluation) -> [f64; MAX_INPUTS] {
        let x = self.inputs.scale(&evaluation.inputs);
        let mut gradient = [0.0; MAX_INPUTS];
        let all = with_slopes(&self.centres, self.reach, &x).zip(&self.weights).zip(&self.centres);
        for (((_, slope), w), centre) in all {
            for (index, axis) in self.inputs.axes.iter().enumerate() {
                let slope = slope * w * (centre[index] - x[index]);
                gradient[axis.input] += slope / (axis.max - axis.min);
            }
        }
        gradient
    }

    /// Half-width at a fraction, with that of the model.
    pub(super) fn halfwidth(&self, share: f64, of_model: f64) -> f64 {
        share * self.residual + (1.0 - share) * of_model.hypot(self.difference)
    }
}
