//! Verifies that samples are bit-identical to an evaluation with a separate copy of the model.
//!
//! It runs on the machine of the twin: another processor may round a fused product otherwise.

use rom::evaluation::Evaluation;
use rom::evaluator::Evaluator;
use rom::inputs::Inputs;
use rom::model::{Model, Selection};
use rom::reconstructor::Reconstructor;
use serde::Serialize;
use wire::layout::{COEFFICIENTS_MAX, flags};
use wire::{FieldSample, State};

/// Evaluates samples again and counts those that differ.
#[derive(Debug)]
pub struct Verifier {
    evaluator: Evaluator,
    reconstructor: Reconstructor,
    evaluation: Evaluation,
    expected: Vec<f32>,
    /// Run and number of the newest state.
    newest: (u64, u64),
    /// The counts so far.
    pub counts: Counts,
}

/// Counts of verified and of wrong samples.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Counts {
    /// Fields verified.
    pub fields_checked: u64,
    /// Fields of which at least one bit was wrong.
    pub wrong_fields: u64,
    /// States with data verified.
    pub states_checked: u64,
    /// States whose force or coefficients were wrong.
    pub wrong_states: u64,
    /// States that came out of order within a run of the twin.
    pub states_out_of_order: u64,
    /// States that were sent and did not come, by jumps of the number within a run.
    pub states_lost: u64,
}

impl Verifier {
    /// A verifier of fields of all nodes in the model's order, from a model file's bytes.
    ///
    /// # Errors
    /// The bytes are no model.
    pub fn new(model: &[u8]) -> anyhow::Result<Self> {
        let model = Model::from_bytes(model)?;
        let evaluator = Evaluator::new(&model.header)?;
        let reconstructor = Reconstructor::new(&model, &Selection::default())?;
        Ok(Self {
            evaluation: evaluator.evaluation(),
            expected: vec![0.0; reconstructor.entries()],
            evaluator,
            reconstructor,
            newest: (0, 0),
            counts: Counts::default(),
        })
    }

    fn evaluate(&mut self, pressure_mpa: f64, gap_mm: f64) {
        self.evaluator.evaluate(Inputs::new(pressure_mpa, gap_mm), &mut self.evaluation);
    }

    /// Verifies order and values of a state.
    pub fn state(&mut self, state: &State) {
        let (run, seq) = self.newest;
        if state.boot_id == run {
            self.counts.states_out_of_order += u64::from(state.seq <= seq);
            self.counts.states_lost += state.seq.saturating_sub(seq + 1);
        }
        self.newest = (state.boot_id, state.seq);
        if state.flags & flags::NO_DATA != 0 {
            return;
        }
        self.evaluate(state.pressure_mpa, state.gap_mm);
        let coefficients = self.evaluation.coefficients.iter().take(COEFFICIENTS_MAX);
        let coefficients = coefficients.map(|a| (*a as f32).to_bits());
        // Of the scenes there are those whose states carry coefficients; the others have their fields to be verified by.
        let carried = state.coefficients();
        let same = state.contact_force_n.to_bits() == self.evaluation.contact_force_n.to_bits()
            && (carried.is_empty() || carried.iter().map(|a| a.to_bits()).eq(coefficients));
        self.counts.states_checked += 1;
        self.counts.wrong_states += u64::from(!same);
    }

    /// Verifies a field against its own header.
    pub fn field(&mut self, sample: &FieldSample) {
        let header = sample.header();
        self.evaluate(header.pressure_mpa, header.gap_mm);
        let computed = self.reconstructor.reconstruct_into(&self.evaluation, &mut self.expected).is_ok();
        let pairs = || sample.values().iter().zip(&self.expected);
        let same = sample.values().len() == self.expected.len()
            && pairs().all(|(found, wanted)| found.to_bits() == wanted.to_bits());
        self.counts.fields_checked += 1;
        self.counts.wrong_fields += u64::from(!(computed && same));
    }
}

impl Counts {
    /// Whether something was verified and nothing was wrong. Lost states are not wrong.
    pub fn all_correct(&self) -> bool {
        self.fields_checked + self.states_checked > 0
            && (self.wrong_fields, self.wrong_states, self.states_out_of_order) == (0, 0, 0)
    }
}
