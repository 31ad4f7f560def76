//! Result of an evaluation, without fields: plain data, allocated once.

use crate::halfwidths::HalfWidths;
use crate::hull::{DomainStatus, TrainingRange};
use crate::inputs::{GAP, Inputs, MAX_INPUTS, PRESSURE};
use crate::kernel::sums::Scratch;
use crate::learned::LearnedState;
use crate::snapshots::RegimeKind;
use thiserror::Error;

/// Warnings about an evaluation. Every correction of a value sets a flag.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flags {
    /// The state lies outside the training hull.
    pub extrapolated: bool,
    /// The interpolated force was negative and was lifted to 0.
    pub force_clamped: bool,
    /// The model was not trained on contact forces: force, gradient and half-width are NaN.
    pub no_force: bool,
    /// The pressure has passed a limit ([`crate::branch`]).
    pub snapped: bool,
    /// The past does not determine the branch ([`crate::branch`]).
    pub branch_unknown: bool,
    /// The model has no onset.
    pub no_onset: bool,
    /// Why there is no answer; force, gradients and coefficients are then NaN.
    pub refusal: Option<Refusal>,
}

/// Why a model has no answer at a state outside its training range. [`crate::evaluator::Evaluator::refusal`] adds which input is outside.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum Refusal {
    /// The distance is above [`TrainingRange::ANSWERED`].
    #[error(
        "the state lies farther outside the training range than the trained states are wide; the model has no answer there"
    )]
    TooFar,
    /// The shape is none of the body ([`crate::body`]).
    #[error(
        "the state lies outside the training range, and the body cannot have the model's shape there: it is stretched beyond its \
         law, or a chamber has a volume that its walls cannot hold"
    )]
    Impossible,
}

/// The model's answer at one state. Reused between calls: [`crate::evaluator::Evaluator::evaluation`] sizes it.
#[derive(Clone, Debug)]
pub struct Evaluation {
    /// The state; NaN for an input that the model does not have.
    pub inputs: Inputs,
    /// Regime that the state is in; the coefficients belong to its basis.
    pub regime: RegimeKind,
    /// Modal coefficients, group after group; empty if the model was not trained in this regime.
    pub coefficients: Vec<f64>,
    /// Contact force in N, never negative.
    pub contact_force_n: f64,
    /// Derivative of the force with respect to each input, in N per unit of the input.
    pub force_gradient: [f64; MAX_INPUTS],
    /// Onset pressure of this gap in MPa: 0 if the actuator's weight closes the gap, `None` if out of reach or if the model has no
    /// onset ([`Flags::no_onset`]).
    pub onset_pressure_mpa: Option<f64>,
    /// Position of the state with respect to the training range of its regime.
    pub domain: DomainStatus,
    /// Distance to the training hull over inputs scaled to [0, 1]; 0 inside.
    pub domain_distance: f64,
    /// How far each input is outside the values of the training, in its unit: above 0 over the largest, below 0 under the smallest.
    pub outside_by: [f64; MAX_INPUTS],
    /// Half-widths with the model's nominal coverage; [`HalfWidths::UNKNOWN`] unless the state is inside the training range.
    pub halfwidths: HalfWidths,
    /// Half-widths of the outputs of a model learned from measurements, by coefficient; NaN where nothing is known. Empty for other models.
    pub output_half_widths: Vec<f64>,
    /// What was unusual about the answer.
    pub flags: Flags,
    /// Derivatives of the coefficients, one row per input; empty unless requested.
    pub(crate) gradients: [Vec<f64>; MAX_INPUTS],
    /// Part of each coefficient that is a measured difference ([`crate::difference`]); empty without one.
    pub(crate) difference: Vec<f64>,
    /// Part of the displacement's half-width that comes from it, mm; 0 without one.
    pub(crate) difference_mm: f64,
    pub(crate) scratch: Scratch,
    /// Settled state of a model learned from measurements, to answer without a past.
    pub(crate) settled: Option<Box<LearnedState>>,
}

impl Evaluation {
    /// Evaluation with capacity for `coefficients` modal coefficients.
    pub(crate) fn with_scratch(coefficients: usize, scratch: Scratch) -> Self {
        Self {
            inputs: Inputs::new(f64::NAN, f64::NAN),
            regime: RegimeKind::Free,
            coefficients: Vec::with_capacity(coefficients),
            contact_force_n: 0.0,
            force_gradient: [0.0; MAX_INPUTS],
            onset_pressure_mpa: None,
            domain: DomainStatus::Inside,
            domain_distance: 0.0,
            outside_by: [0.0; MAX_INPUTS],
            halfwidths: HalfWidths::default(),
            output_half_widths: Vec::with_capacity(coefficients),
            flags: Flags::default(),
            gradients: std::array::from_fn(|_| Vec::with_capacity(coefficients)),
            difference: Vec::with_capacity(coefficients),
            difference_mm: 0.0,
            scratch,
            settled: None,
        }
    }

    /// Sets the distance to the training range with what follows from it: outside nothing is known about the error.
    pub(crate) fn set_distance(&mut self, distance: f64) {
        self.domain_distance = distance;
        self.domain = TrainingRange::status(distance);
        self.flags.extrapolated = self.domain != DomainStatus::Inside;
        if self.flags.extrapolated {
            self.halfwidths = HalfWidths::UNKNOWN;
        }
    }

    /// Derivatives of the coefficients with respect to one input, per unit of the input; 0 for inputs that the regime does
    /// not take. Empty after [`crate::evaluator::Evaluator::evaluate`], which leaves them out.
    ///
    /// # Panics
    /// If `input` is not below [`MAX_INPUTS`].
    pub fn coefficient_gradient(&self, input: usize) -> &[f64] {
        &self.gradients[input]
    }

    /// Part of each coefficient that is a measured difference from the finite elements; empty without one.
    pub fn coefficient_difference(&self) -> &[f64] {
        &self.difference
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

/// What a model must have so that a [`Number`] has a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NumberNeeds {
    /// Every model has the number.
    Nothing,
    /// Contact forces.
    Forces,
    /// A von Mises stress.
    Stress,
    /// An onset of contact.
    Onset,
}

/// A number that the evaluations of all models have, or of those that were trained for it.
#[derive(Clone, Copy, Debug)]
pub struct Number {
    /// Name with the unit, as in every payload.
    pub key: &'static str,
    /// Unit; empty for a whole number.
    pub unit: &'static str,
    /// What it is, for people.
    pub about: &'static str,
    /// What a model must have for it ([`crate::model::ModelHeader::has_number`]).
    pub needs: NumberNeeds,
    /// Its value; NaN where it is not known.
    pub value: fn(&Evaluation) -> f64,
}

/// All of them. [`numbers`](crate::numbers) is the list that payloads and this table are made of.
pub const NUMBERS: &[Number] = crate::numbers!(@list table ());

/// Writes all [`NUMBERS`] of an evaluation into the fields of a payload that have their keys as names, whatever the fields' types:
/// `numbers!(state, &evaluation)`. A number that is added to the list has to be in every payload; the compiler names those without it.
#[macro_export]
macro_rules! numbers {
    (@fill ($to:expr, $from:expr) $($key:ident, $unit:expr, $about:expr, $needs:ident, $e:ident => $value:expr;)*) => {{
        let from: &$crate::evaluation::Evaluation = $from;
        $($to.$key = { let $e = from; $value } as _;)*
    }};
    (@table () $($key:ident, $unit:expr, $about:expr, $needs:ident, $e:ident => $value:expr;)*) => {
        &[$(Number {
            key: stringify!($key),
            unit: $unit,
            about: $about,
            needs: NumberNeeds::$needs,
            value: |$e| $value,
        }),*]
    };
    (@list $what:ident $context:tt) => {
        $crate::numbers! { @$what $context
            contact_force_n, "N", "Contact force", Forces, e => e.contact_force_n;
            onset_pressure_mpa, "MPa", "Pressure at which contact begins; infinite: out of reach", Onset,
                e => e.onset_pressure_mpa.unwrap_or(if e.flags.no_onset { f64::NAN } else { f64::INFINITY });
            force_halfwidth_n, "N", "Half-width of the force; NaN outside the training states", Forces,
                e => e.halfwidths.force_n;
            displacement_halfwidth_mm, "mm", "Half-width of the worst node; NaN outside", Nothing,
                e => e.halfwidths.displacement_mm;
            von_mises_halfwidth_mpa, "MPa", "Half-width of the worst node; NaN outside", Stress,
                e => e.halfwidths.stress_mpa;
            domain_distance, "1", "Distance to the training states, inputs scaled", Nothing, e => e.domain_distance;
            domain_status, "", "0 inside the training states, 1 near, 2 outside", Nothing, e => f64::from(e.domain.number());
            regime, "", "1 free, 2 contact", Nothing, e => f64::from(e.regime.number());
        }
    };
    ($to:expr, $from:expr) => { $crate::numbers!(@list fill ($to, $from)) };
}
