//! One instance: the model with its present inputs, and what was computed from them.

use crate::variables::{
    self, ChosenNode, FIRST_INPUT, FIRST_OUTPUT, MODEL_FILE, NODES_FILE, Output, Quantity, TIME,
};
use rom::evaluation::Evaluation;
use rom::evaluator::Evaluator;
use rom::hull::DomainStatus;
use rom::inputs::{GAP, Inputs, MAX_INPUTS};
use rom::model::{ModelReader, Nodes, Selection};
use rom::reconstructor::Reconstructor;
use rom::snapshots::FieldKind;
use std::io::Cursor;
use std::path::Path;

/// A selection of fields and nodes with its memory.
struct Part {
    reconstructor: Reconstructor,
    values: Vec<f32>,
    /// Largest stress of the selection, MPa.
    max_stress_mpa: f64,
    is_current: bool,
}

impl Part {
    fn new(model: &rom::model::Model, fields: Option<Vec<String>>, nodes: Nodes) -> Result<Self, String> {
        let selection = Selection { fields, nodes };
        let reconstructor = Reconstructor::new(model, &selection).map_err(|error| error.to_string())?;
        let values = vec![0.0; reconstructor.entries()];
        Ok(Self { reconstructor, values, max_stress_mpa: f64::NAN, is_current: false })
    }

    fn update(&mut self, evaluation: &Evaluation) -> Result<(), String> {
        if !self.is_current {
            let peaks = self.reconstructor.reconstruct_into(evaluation, &mut self.values);
            let stress = peaks.map_err(|error| error.to_string())?.stress_mpa;
            self.max_stress_mpa = stress.map_or(f64::NAN, |peak| peak.value.into());
            self.is_current = true;
        }
        Ok(())
    }
}

/// The running model.
pub(crate) struct Instance {
    /// Keys of the inputs.
    keys: Vec<String>,
    start: Inputs,
    inputs: Inputs,
    time_s: f64,
    evaluator: Evaluator,
    evaluation: Evaluation,
    is_current: bool,
    outputs: Vec<Output>,
    nodes: Vec<ChosenNode>,
    /// All fields at the chosen nodes; none chosen, none.
    at_nodes: Option<Part>,
    /// The stress at all nodes; none when the model has no stress.
    stress: Option<Part>,
}

impl Instance {
    /// Reads the resources of an FMU.
    pub(crate) fn open(resources: &Path, token: &str) -> Result<Self, String> {
        let at = |name: &str, error: &dyn std::fmt::Display| {
            format!("{}: {error}; export the FMU again", resources.join(name).display())
        };
        let bytes = std::fs::read(resources.join(MODEL_FILE)).map_err(|e| at(MODEL_FILE, &e))?;
        let mut reader = ModelReader::open(Cursor::new(&bytes)).map_err(|e| at(MODEL_FILE, &e))?;
        let model = reader.load(&Selection::default()).map_err(|e| at(MODEL_FILE, &e))?;
        let text = std::fs::read_to_string(resources.join(NODES_FILE)).map_err(|e| at(NODES_FILE, &e))?;
        let nodes = variables::read_nodes(&text).map_err(|e| at(NODES_FILE, &e))?;
        let expected = variables::token(&bytes, &nodes);
        if token != expected {
            return Err(format!(
                "instantiation token: expected {expected}, found {token}; modelDescription.xml belongs to another model"
            ));
        }
        let evaluator = Evaluator::new(&model.header).map_err(|error| error.to_string())?;
        let start = variables::start(&model).into_iter().enumerate();
        let start = start.fold(Inputs::new(0.0, 0.0), |inputs, (at, value)| inputs.with(at, value));
        let chosen: Vec<u32> = nodes.iter().map(|chosen| chosen.node).collect();
        let stress = model.header.fields.iter().find(|f| f.spec.kind == FieldKind::Stress);
        let stress = stress.map(|field| Part::new(&model, Some(vec![field.spec.name.clone()]), Nodes::All));
        Ok(Self {
            keys: model.header.inputs.iter().map(|input| input.key()).collect(),
            start,
            inputs: start,
            time_s: 0.0,
            evaluation: evaluator.evaluation(),
            is_current: false,
            outputs: variables::outputs(&model.header, &nodes),
            at_nodes: (!nodes.is_empty())
                .then(|| Part::new(&model, None, Nodes::List(chosen)))
                .transpose()?,
            stress: stress.transpose()?,
            evaluator,
            nodes,
        })
    }

    /// As after instantiation.
    pub(crate) fn reset(&mut self) -> Result<(), String> {
        (self.inputs, self.is_current) = (self.start, false);
        self.move_to(0.0)
    }

    /// Moves the time; outputs do not depend on it.
    pub(crate) fn move_to(&mut self, time_s: f64) -> Result<(), String> {
        if !time_s.is_finite() {
            return Err(format!("expected a time in s, found {time_s}"));
        }
        self.time_s = time_s;
        Ok(())
    }

    /// Sets an input. Not a number, or infinite where only the gap may be: refused, the old value stands.
    pub(crate) fn set(&mut self, reference: u32, value: f64) -> Result<(), String> {
        let at = reference.wrapping_sub(FIRST_INPUT) as usize;
        let key = self.keys.get(at).filter(|_| at < MAX_INPUTS);
        let key = key.ok_or_else(|| format!("value reference {reference} is no input"))?;
        if value.is_nan() || value.is_infinite() && at != GAP {
            return Err(format!("{key}: expected a number, found {value}; the value before stands"));
        }
        if self.inputs.values()[at] != value {
            self.inputs = self.inputs.with(at, value);
            self.is_current = false;
        }
        Ok(())
    }

    /// Evaluates the model where an input changed.
    fn update(&mut self) -> Result<(), String> {
        if self.is_current {
            return Ok(());
        }
        self.evaluator.give(&self.inputs, &mut self.evaluation).map_err(|error| error.to_string())?;
        self.evaluator.evaluate(self.inputs, &mut self.evaluation);
        if !self.evaluator.has_regime(self.evaluation.regime) {
            let name = self.evaluator.regime_name(self.evaluation.regime);
            return Err(format!("this state belongs to regime {name}, in which the model was not trained"));
        }
        for part in self.at_nodes.iter_mut().chain(&mut self.stress) {
            part.is_current = false;
        }
        self.is_current = true;
        Ok(())
    }

    fn quantity(&self, reference: u32, integer: bool) -> Result<Quantity, String> {
        let at = reference.wrapping_sub(FIRST_OUTPUT) as usize;
        let found = self.outputs.get(at).map(|output| output.quantity);
        let kind = if integer { "Int32" } else { "Float64" };
        found
            .filter(|quantity| quantity.is_integer() == integer)
            .ok_or_else(|| format!("value reference {reference} is no {kind} of this FMU"))
    }

    /// An input, the time or an output that is a Float64.
    pub(crate) fn float(&mut self, reference: u32) -> Result<f64, String> {
        if reference == TIME {
            return Ok(self.time_s);
        }
        let input = reference.wrapping_sub(FIRST_INPUT) as usize;
        if input < self.keys.len() {
            return Ok(self.inputs.values()[input]);
        }
        let quantity = self.quantity(reference, false)?;
        self.update()?;
        let found = &self.evaluation;
        Ok(match quantity {
            Quantity::Force => found.contact_force_n,
            Quantity::ForceBy(input) => found.force_gradient[input],
            Quantity::Onset => found.onset_pressure_mpa.unwrap_or(f64::INFINITY),
            Quantity::ForceHalfwidth => found.halfwidths.force_n,
            Quantity::DisplacementHalfwidth => found.halfwidths.displacement_mm,
            Quantity::StressHalfwidth => found.halfwidths.stress_mpa,
            Quantity::DomainDistance => found.domain_distance,
            Quantity::MaxStress => {
                let Some(part) = &mut self.stress else { return Ok(f64::NAN) };
                part.update(found)?;
                part.max_stress_mpa
            }
            Quantity::AtNode { field, chosen } => {
                let part = self.at_nodes.as_mut().ok_or("no node was chosen")?;
                part.update(found)?;
                part.values[field * self.nodes.len() + chosen].into()
            }
            Quantity::DomainStatus | Quantity::Regime => return Err("an Int32".into()),
        })
    }

    /// An output that is an Int32.
    pub(crate) fn integer(&mut self, reference: u32) -> Result<i32, String> {
        let quantity = self.quantity(reference, true)?;
        self.update()?;
        let domain = match self.evaluation.domain {
            DomainStatus::Inside => 0,
            DomainStatus::Near => 1,
            DomainStatus::Outside => 2,
        };
        let regime = self.evaluation.regime.number() as i32;
        Ok(if quantity == Quantity::Regime { regime } else { domain })
    }
}
