//! Judges samples to the bit: computes each again from its own copy of the model.
//!
//! It belongs on the machine of the twin: another processor may round a fused product otherwise.

use rom::evaluation::{Evaluation, Input};
use rom::model::Model;
use rom::predict::{Nodes, Predictor, Selection};
use rom::regime::RegimeSwitch;
use wire::layout::{COEFFICIENTS_MAX, flags};
use wire::{FieldSample, State};

/// What was looked at, and what was wrong with it.
#[derive(Debug)]
pub struct Judge {
    predictor: Predictor,
    evaluation: Evaluation,
    expected: Vec<f32>,
    /// Fields looked at.
    pub fields: u64,
    /// Fields of which at least one bit was wrong.
    pub wrong_fields: u64,
    /// States with data looked at.
    pub states: u64,
    /// States whose force or coefficients were wrong.
    pub wrong_states: u64,
    /// States that came out of order within a run of the twin.
    pub disordered: u64,
    /// States that were sent and did not come, by jumps of the number within a run.
    pub lost_states: u64,
    /// Run and number of the newest state.
    newest: (u64, u64),
}

impl Judge {
    /// A judge with a model file's bytes; judges fields of all nodes in the model's order.
    ///
    /// # Panics
    /// When the bytes are no model.
    pub fn new(model: &[u8]) -> Self {
        let model = Model::from_bytes(model).expect("a model");
        let everything = Selection { fields: None, nodes: Nodes::All };
        let predictor = Predictor::new(&model, &everything).expect("a model predicts itself");
        Self {
            evaluation: predictor.evaluation(),
            expected: vec![0.0; predictor.entries()],
            predictor,
            fields: 0,
            wrong_fields: 0,
            states: 0,
            wrong_states: 0,
            disordered: 0,
            lost_states: 0,
            newest: (0, 0),
        }
    }

    fn evaluate(&mut self, pressure_mpa: f64, gap_mm: f64) {
        // Only the label has a memory; values follow pressure and gap alone.
        let mut switch = RegimeSwitch::default();
        self.predictor.evaluate(Input { pressure_mpa, gap_mm }, &mut switch, &mut self.evaluation);
    }

    /// Judges order and values of a state.
    pub fn state(&mut self, state: &State) {
        let (run, seq) = self.newest;
        if state.boot_id == run {
            self.disordered += u64::from(state.seq <= seq);
            self.lost_states += state.seq.saturating_sub(seq + 1);
        }
        self.newest = (state.boot_id, state.seq);
        if state.flags & flags::NO_DATA != 0 {
            return;
        }
        self.evaluate(state.pressure_mpa, state.gap_mm);
        let coefficients = self.evaluation.coefficients.iter().take(COEFFICIENTS_MAX);
        let coefficients = coefficients.map(|a| (*a as f32).to_bits());
        let same = state.contact_force_n.to_bits() == self.evaluation.contact_force_n.to_bits()
            && state.coefficients().iter().map(|a| a.to_bits()).eq(coefficients);
        self.states += 1;
        self.wrong_states += u64::from(!same);
    }

    /// Judges a field against its own header.
    pub fn field(&mut self, sample: &FieldSample) {
        let header = sample.header();
        self.evaluate(header.pressure_mpa, header.gap_mm);
        let computed = self.predictor.reconstruct_into(&self.evaluation, &mut self.expected).is_ok();
        let pairs = || sample.values().iter().zip(&self.expected);
        let same = sample.values().len() == self.expected.len()
            && pairs().all(|(found, wanted)| found.to_bits() == wanted.to_bits());
        self.fields += 1;
        self.wrong_fields += u64::from(!(computed && same));
    }

    /// The verdict of a story: something was looked at and nothing was wrong.
    ///
    /// # Panics
    /// Otherwise.
    pub fn acquit(&self) {
        assert!(self.fields + self.states > 0, "nothing was judged");
        let wrong = (self.wrong_fields, self.wrong_states, self.disordered);
        assert_eq!(wrong, (0, 0, 0), "of {} fields and {} states", self.fields, self.states);
    }

    /// The counts, for scripts.
    pub fn report(&self) -> serde_json::Value {
        serde_json::json!({
            "fields_checked": self.fields, "wrong_fields": self.wrong_fields,
            "states_checked": self.states, "wrong_states": self.wrong_states,
            "states_out_of_order": self.disordered,
        })
    }
}
