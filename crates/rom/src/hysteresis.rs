//! A label of the regime that does not flip with sensor noise: for a running twin.

use crate::evaluation::Evaluation;
use crate::evaluator::Evaluator;
use crate::inputs::Inputs;
use crate::snapshots::RegimeKind;

/// The regime to show for a state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RegimeLabel {
    /// Contact as soon as the onset is reached, free only when it is undercut by the model's margin.
    pub regime: RegimeKind,
    /// The label still says contact although the pressure is just below the onset.
    pub held: bool,
}

/// An evaluator that remembers the last label. Values follow the inputs alone: only the label has a memory.
#[derive(Clone, Debug)]
pub struct HysteresisEvaluator {
    evaluator: Evaluator,
    last: Option<RegimeKind>,
}

impl HysteresisEvaluator {
    /// Without memory: the first label is the regime of the first state.
    pub fn new(evaluator: Evaluator) -> Self {
        Self { evaluator, last: None }
    }

    /// The evaluator alone.
    pub fn into_evaluator(self) -> Evaluator {
        self.evaluator
    }

    /// As [`Evaluator::state`], with the label.
    pub fn state(&mut self, inputs: Inputs, out: &mut Evaluation) -> RegimeLabel {
        self.evaluator.state(inputs, out);
        let margin_mpa = self.evaluator.hysteresis_mpa();
        let held = self.last == Some(RegimeKind::Contact)
            && out.regime == RegimeKind::Free
            && out.onset_pressure_mpa.is_some_and(|onset| inputs.pressure_mpa() > onset - margin_mpa);
        let regime = if held { RegimeKind::Contact } else { out.regime };
        self.last = Some(regime);
        RegimeLabel { regime, held }
    }

    /// As [`Evaluator::complete`].
    pub fn complete(&self, out: &mut Evaluation) {
        self.evaluator.complete(out);
    }
}
