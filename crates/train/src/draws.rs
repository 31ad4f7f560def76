//! Random states inside the training range of a model.

use rom::evaluation::Evaluation;
use rom::evaluator::Evaluator;
use rom::hull::DomainStatus;
use rom::inputs::{GAP, Inputs, PRESSURE};
use rom::model::{Model, ModelError};
use rom::rng::Rng;
use rom::snapshots::RegimeKind;
use thiserror::Error;

/// Why no states can be drawn from a model.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum DrawsError {
    /// It has no such regime.
    #[error("the model has no regime {0} to draw states from")]
    NoRegime(&'static str),
    /// Its regime has other inputs.
    #[error("the regime {0} takes no pressure")]
    NoPressure(&'static str),
    /// It cannot predict.
    #[error(transparent)]
    Predict(#[from] ModelError),
}

/// Draws states evenly over the box around a regime's samples and keeps those in its training range.
#[derive(Debug)]
pub struct Draws {
    evaluator: Evaluator,
    evaluation: Evaluation,
    kind: RegimeKind,
    pressure_mpa: [f64; 2],
    /// None: a regime without a gap.
    gap_mm: Option<[f64; 2]>,
    random: Rng,
}

impl Draws {
    /// Draws from a regime of a model.
    ///
    /// # Errors
    /// The model has no such regime, or the regime takes no pressure.
    pub fn new(model: &Model, kind: RegimeKind, seed: u64) -> Result<Self, DrawsError> {
        let regime = model.regime(kind).ok_or(DrawsError::NoRegime(kind.name()))?;
        let evaluator = Evaluator::new(&model.header)?;
        Ok(Self {
            evaluation: evaluator.evaluation(),
            evaluator,
            kind,
            pressure_mpa: regime.inputs.range(PRESSURE).ok_or(DrawsError::NoPressure(kind.name()))?,
            gap_mm: regime.inputs.range(GAP),
            random: Rng::new(seed),
        })
    }

    /// One draw, after `adjust`; none when it is outside the training range or belongs to the other regime.
    pub fn draw(&mut self, adjust: impl Fn(Inputs) -> Inputs) -> Option<Inputs> {
        let pressure_mpa = self.within(self.pressure_mpa);
        let gap_mm = self.gap_mm.map_or(f64::INFINITY, |range| self.within(range));
        let state = adjust(Inputs::new(pressure_mpa, gap_mm));
        self.evaluator.evaluate(state, &mut self.evaluation);
        let inside = self.evaluation.regime == self.kind && self.evaluation.domain == DomainStatus::Inside;
        inside.then_some(state)
    }

    /// A constant input consumes no random number, so adding one does not change the other samples of a seed.
    fn within(&mut self, [low, high]: [f64; 2]) -> f64 {
        if low < high { low + (high - low) * self.random.uniform() } else { low }
    }
}
