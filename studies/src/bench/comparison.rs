//! Cost of a model's parameters, at equal modes.

use super::compute::inputs;
use super::measure::Durations;
use rom::evaluator::{Evaluator, Query};
use rom::inputs::Inputs;
use rom::model::{Model, Selection};
use rom::model_state::ModelState;
use serde::Serialize;
use softtwin::output;

/// Medians of one model, its parameters at the values of the file.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Cost {
    /// Coefficients of the regime measured.
    pub coefficients: usize,
    /// Input to full field, us.
    pub predict_us_p50: f64,
    /// Coefficients, force, gradients, half-widths alone, us.
    pub state_only_us_p50: f64,
}

/// Both models, measured in turn in one loop.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Comparison {
    /// The model.
    pub model: Cost,
    /// The one without parameters.
    pub plain: Cost,
    /// Ratio of the whole field's time to that of the plain model.
    pub ratio: f64,
    /// The same if the model had as many coefficients as the plain one: what reconstruction costs grows with their number.
    pub ratio_at_equal_modes: f64,
}

struct Subject {
    inputs: Vec<Inputs>,
    full: ModelState,
    evaluator: Evaluator,
    predict: Durations,
    state: Durations,
}

impl Subject {
    fn new(model: &Model) -> anyhow::Result<Self> {
        Ok(Self {
            inputs: inputs(model)?,
            full: ModelState::new(model, &Selection::default())?,
            evaluator: Evaluator::new(&model.header)?,
            predict: Durations::new("predict"),
            state: Durations::new("state only"),
        })
    }

    fn cost(&self) -> Cost {
        Cost {
            coefficients: self.full.evaluation().coefficients.len(),
            predict_us_p50: self.predict.p50(),
            state_only_us_p50: self.state.p50(),
        }
    }
}

/// Measures both.
pub fn run(model: &Model, plain: &Model, samples: usize) -> anyhow::Result<Comparison> {
    let mut subjects = [Subject::new(model)?, Subject::new(plain)?];
    for sample in 0..samples {
        for subject in &mut subjects {
            let Subject { inputs, full, predict, .. } = subject;
            let input = inputs[sample % inputs.len()];
            full.update(input)?; // brings the basis into the cache
            predict.time(|| full.update(input));
        }
    }
    for subject in &mut subjects {
        let mut evaluation = subject.evaluator.evaluation();
        for input in subject.inputs.iter().cycle().take(samples) {
            subject.state.time(|| subject.evaluator.answer(*input, Query::STATE, &mut evaluation));
        }
    }
    let [model, plain] = subjects.each_ref().map(Subject::cost);
    let a_coefficient = (model.predict_us_p50 - model.state_only_us_p50) / model.coefficients as f64;
    let equal = model.state_only_us_p50 + a_coefficient * plain.coefficients as f64;
    let ratio = model.predict_us_p50 / plain.predict_us_p50;
    Ok(Comparison { model, plain, ratio, ratio_at_equal_modes: equal / plain.predict_us_p50 })
}

impl Comparison {
    /// Prints the figures.
    pub fn print(&self) -> anyhow::Result<()> {
        let Self { model, plain, .. } = self;
        for (name, cost) in [("this model", model), ("plain model", plain)] {
            output!(
                "{name:<12} whole field {:>8.1} us, state only {:>6.1} us, {} coefficients (medians, in turn)",
                cost.predict_us_p50,
                cost.state_only_us_p50,
                cost.coefficients
            )?;
        }
        output!(
            "whole field: {:.2} times the plain model's, {:.2} times at equal modes",
            self.ratio,
            self.ratio_at_equal_modes
        )?;
        Ok(())
    }
}
