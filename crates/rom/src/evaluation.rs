//! What an evaluation gives before any field is reconstructed: plain data, allocated once.

use crate::halfwidths::HalfWidths;
use crate::hull::DomainStatus;
use crate::inputs::{GAP, Inputs, MAX_INPUTS, PRESSURE};
use crate::interpolant::{Interpolant, KernelScratch, gradient_rows};
use crate::model::RegimeModel;
use crate::snapshots::RegimeKind;

/// What deserves a reader's attention. Nothing is clamped in silence: each flag says what was done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flags {
    /// The state lies outside the training hull.
    pub extrapolated: bool,
    /// The interpolated force was negative and was lifted to 0.
    pub force_clamped: bool,
}

/// The model's answer at one state. Reused between calls: [`crate::evaluator::Evaluator::evaluation`] sizes it.
#[derive(Clone, Debug)]
pub struct Evaluation {
    /// The state.
    pub inputs: Inputs,
    /// Regime that the state is in; the coefficients belong to its basis.
    pub regime: RegimeKind,
    /// Modal coefficients, group after group; none when the model was not trained in this regime.
    pub coefficients: Vec<f64>,
    /// Contact force in N, never negative.
    pub contact_force_n: f64,
    /// Derivative of the force by each input, in N per unit of the input.
    pub force_gradient: [f64; MAX_INPUTS],
    /// Onset pressure of this gap in MPa: 0 when the actuator's own weight touches, none when out of reach.
    pub onset_pressure_mpa: Option<f64>,
    /// Where the state lies with respect to the training samples of its regime.
    pub domain: DomainStatus,
    /// Distance to the training hull over inputs scaled to [0, 1]; 0 inside.
    pub domain_distance: f64,
    /// Half-widths that cover the stated share of states.
    pub halfwidths: HalfWidths,
    /// Flags.
    pub flags: Flags,
    /// By input: derivatives of the coefficients.
    pub(crate) gradients: Vec<Vec<f64>>,
    pub(crate) scratch: KernelScratch,
}

impl Evaluation {
    /// Room for the answers of interpolants of up to so many inputs, terms and outputs.
    pub(crate) fn with_room(dimensions: usize, terms: usize, outputs: usize) -> Self {
        let mut evaluation = Self {
            inputs: Inputs::new(f64::NAN, f64::NAN),
            regime: RegimeKind::Free,
            coefficients: Vec::with_capacity(outputs),
            contact_force_n: 0.0,
            force_gradient: [0.0; MAX_INPUTS],
            onset_pressure_mpa: None,
            domain: DomainStatus::Inside,
            domain_distance: 0.0,
            halfwidths: HalfWidths::default(),
            flags: Flags::default(),
            gradients: Vec::new(),
            scratch: KernelScratch::default(),
        };
        evaluation.reserve(dimensions, dimensions, terms, outputs);
        evaluation
    }

    /// Room for the interpolants of one regime.
    pub(crate) fn room(regime: &RegimeModel) -> Self {
        let terms = regime.interpolants().map(Interpolant::terms).max().unwrap_or(0);
        Self::with_room(regime.inputs.dimensions(), terms, regime.coefficient_count())
    }

    /// Allocates only where there is less room than asked for.
    pub(crate) fn reserve(&mut self, inputs: usize, dimensions: usize, terms: usize, outputs: usize) {
        self.scratch.reserve(dimensions, terms);
        let rows = gradient_rows(inputs).max(self.gradients.len());
        self.gradients.resize_with(rows, || Vec::with_capacity(outputs));
    }

    /// Derivatives of the coefficients by the input at a position, per unit of the input; 0 for one that the regime does
    /// not take.
    ///
    /// # Panics
    /// When the model has no input at this position.
    pub fn coefficient_gradient(&self, input: usize) -> &[f64] {
        &self.gradients[input]
    }

    /// dF/dP in N/MPa.
    pub fn force_by_pressure_n_per_mpa(&self) -> f64 {
        self.force_gradient[PRESSURE]
    }

    /// dF/dgap in N/mm.
    pub fn force_by_gap_n_per_mm(&self) -> f64 {
        self.force_gradient[GAP]
    }
}
