//! Fields of one kind at the chosen nodes, and the largest stress of all nodes; computed when they are read.

use crate::variables::ChosenNode;
use rom::evaluation::Evaluation;
use rom::evaluator::Evaluator;
use rom::model::{Model, Nodes, Selection};
use rom::reconstructor::Reconstructor;

/// Group of fields with their coefficients, which are computed at most once per state, and only if one of the fields is read.
pub(crate) struct Part {
    /// Indices of the fields.
    fields: Vec<usize>,
    evaluator: Evaluator,
    evaluation: Evaluation,
    has_coefficients: bool,
    at_nodes: Option<AtNodes>,
}

/// The fields at the chosen nodes, field after field.
struct AtNodes {
    reconstructor: Reconstructor,
    values: Vec<f32>,
    is_current: bool,
}

impl Part {
    /// Part with these fields; `None` without fields.
    pub fn new(
        model: &Model,
        evaluator: &Evaluator,
        fields: Vec<usize>,
        nodes: &[ChosenNode],
    ) -> Result<Option<Self>, String> {
        if fields.is_empty() {
            return Ok(None);
        }
        let mut evaluator = evaluator.clone();
        evaluator.restrict(&fields);
        let evaluation = evaluator.evaluation();
        let at_nodes = if nodes.is_empty() { None } else { Some(AtNodes::new(model, &fields, nodes)?) };
        Ok(Some(Self { fields, evaluator, evaluation, has_coefficients: false, at_nodes }))
    }

    /// Marks all results as outdated.
    pub fn forget(&mut self) {
        self.has_coefficients = false;
        if let Some(at_nodes) = &mut self.at_nodes {
            at_nodes.is_current = false;
        }
    }

    /// Coefficients of a state.
    pub fn at(&mut self, state: &Evaluation) -> &Evaluation {
        if !self.has_coefficients {
            (self.evaluation.inputs, self.evaluation.regime) = (state.inputs, state.regime);
            self.evaluation.halfwidths = state.halfwidths;
            (self.evaluation.domain, self.evaluation.flags) = (state.domain, state.flags);
            self.evaluation.domain_distance = state.domain_distance;
            // A moving state has its own, with the linear modes.
            self.evaluation.coefficients.clone_from(&state.coefficients);
            self.evaluator.complete(&mut self.evaluation);
            self.has_coefficients = true;
        }
        &self.evaluation
    }

    /// A field, by its index in the model, at a chosen node; none when it is not one of these.
    pub fn value(&mut self, state: &Evaluation, field: usize, chosen: usize) -> Result<Option<f32>, String> {
        let Some(at) = self.fields.iter().position(|own| *own == field) else { return Ok(None) };
        self.at(state);
        let Some(at_nodes) = &mut self.at_nodes else { return Ok(None) };
        at_nodes.update(&self.evaluation)?;
        Ok(Some(at_nodes.values[at * at_nodes.reconstructor.rows() + chosen]))
    }
}

impl AtNodes {
    fn new(model: &Model, fields: &[usize], nodes: &[ChosenNode]) -> Result<Self, String> {
        let names = fields.iter().map(|field| model.header.fields[*field].spec.name.clone());
        let nodes = Nodes::List(nodes.iter().map(|chosen| chosen.node).collect());
        let selection = Selection { fields: Some(names.collect()), nodes };
        let reconstructor = Reconstructor::new(model, &selection).map_err(|error| error.to_string())?;
        Ok(Self { values: vec![0.0; reconstructor.entries()], reconstructor, is_current: false })
    }

    fn update(&mut self, evaluation: &Evaluation) -> Result<(), String> {
        if !self.is_current {
            let done = self.reconstructor.reconstruct_into(evaluation, &mut self.values);
            done.map_err(|error| error.to_string())?;
            self.is_current = true;
        }
        Ok(())
    }
}

/// The stress: at the chosen nodes, and the largest of all.
pub(crate) struct Stress {
    pub part: Part,
    reconstructor: Reconstructor,
    values: Vec<f32>,
    largest_mpa: Option<f32>,
}

impl Stress {
    /// Reconstructs `field`, the stress that `part` interpolates.
    pub fn new(model: &Model, part: Part, field: usize) -> Result<Self, String> {
        let name = model.header.fields[field].spec.name.clone();
        let selection = Selection { fields: Some(vec![name]), nodes: Nodes::All };
        let reconstructor = Reconstructor::new(model, &selection).map_err(|error| error.to_string())?;
        Ok(Self { part, values: vec![0.0; reconstructor.entries()], reconstructor, largest_mpa: None })
    }

    /// Discards the values of the state before.
    pub fn forget(&mut self) {
        self.part.forget();
        self.largest_mpa = None;
    }

    /// Largest stress of all nodes, MPa.
    pub fn largest_mpa(&mut self, state: &Evaluation) -> Result<f32, String> {
        if let Some(known) = self.largest_mpa {
            return Ok(known);
        }
        let peaks = self.reconstructor.reconstruct_into(self.part.at(state), &mut self.values);
        let peak = peaks.map_err(|error| error.to_string())?.stress_mpa;
        Ok(*self.largest_mpa.insert(peak.map_or(f32::NAN, |peak| peak.value)))
    }
}
