//! One instance: the model with its present inputs and the results computed from them.

use crate::description::{
    self, ChosenNode, FIRST_INPUT, FIRST_OUTPUT, MODEL_FILE, NODES_FILE, Output, OutputQuantity, TIME,
};
use rom::evaluation::{Evaluation, NUMBERS};
use rom::evaluator::{Evaluator, Query};
use rom::inertia::stepper::ReadingError;
use rom::inputs::{GAP, Inputs, MAX_INPUTS};
use rom::model::{Model, Nodes, Selection};
use rom::observable::{Observables, Observed};
use rom::reconstructor::Reconstructor;
use rom::session::{Gaps, Session};
use rom::snapshots::FieldKind;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Most of a list of nodes that is read: some 50,000 nodes.
const MAX_NODES_BYTES: u64 = 1 << 20;

/// Everything that changes in an instance: the state that an importer saves and restores.
#[derive(Clone)]
pub struct InstanceState {
    inputs: Inputs,
    time_s: f64,
    session: Session,
    /// Time of the first step, s; `None` before it and for a model without memory.
    begin_s: Option<f64>,
    evaluation: Evaluation,
    is_current: bool,
}

/// The running model.
pub(crate) struct Instance {
    /// Keys of the inputs.
    keys: Vec<String>,
    start: Inputs,
    now: InstanceState,
    outputs: Vec<Output>,
    observables: Observables,
    /// All fields but the stress.
    others: Option<Part>,
    /// None when the model has no stress.
    stress: Option<Stress>,
}

impl Instance {
    /// Reads the resources of an FMU.
    pub(crate) fn open(resources: &Path, token: &str) -> Result<Self, String> {
        let broken = |name: &str, error: &dyn std::fmt::Display| {
            format!("{}: {error}; export the FMU again", resources.join(name).display())
        };
        let (model, hash) = Model::read(resources.join(MODEL_FILE)).map_err(|e| broken(MODEL_FILE, &e))?;
        let mut text = String::new();
        let file = File::open(resources.join(NODES_FILE)).map_err(|e| broken(NODES_FILE, &e))?;
        file.take(MAX_NODES_BYTES + 1).read_to_string(&mut text).map_err(|e| broken(NODES_FILE, &e))?;
        if text.len() as u64 > MAX_NODES_BYTES {
            return Err(broken(NODES_FILE, &format!("expected at most {MAX_NODES_BYTES} bytes, found more")));
        }
        let nodes = description::read_nodes(&text).map_err(|e| broken(NODES_FILE, &e))?;
        let expected = description::token(&hash, &nodes);
        if token != expected {
            return Err(format!(
                "instantiation token: expected {expected}, found {token}; modelDescription.xml belongs to another model"
            ));
        }
        // Between two steps nothing happens that the importer did not set.
        let session = Session::new(&model, Gaps::Recorded).map_err(|e| broken(MODEL_FILE, &e))?;
        let evaluator = session.evaluator();
        let observables = Observables::of(&model).map_err(|e| broken(MODEL_FILE, &e))?;
        let start = description::start(&model).into_iter().enumerate();
        let start = start.fold(Inputs::new(0.0, 0.0), |inputs, (at, value)| inputs.with(at, value));
        let fields = model.header.fields.iter();
        let stress = fields.clone().position(|field| field.spec.kind == FieldKind::Stress);
        let others = (0..fields.len()).filter(|field| Some(*field) != stress).collect();
        let others = Part::new(&model, evaluator, others, &nodes)?;
        let of_field = |field| match Part::new(&model, evaluator, vec![field], &nodes)? {
            Some(part) => Stress::new(&model, part, field).map(Some),
            None => Ok(None),
        };
        let stress = stress.map(of_field).transpose()?.flatten();
        Ok(Self {
            keys: model.header.inputs.iter().map(|input| input.key()).collect(),
            start,
            outputs: description::outputs(&model.header, &observables, &nodes),
            observables,
            others,
            stress,
            now: InstanceState {
                inputs: start,
                time_s: 0.0,
                evaluation: session.evaluation(),
                begin_s: None,
                is_current: false,
                session,
            },
        })
    }

    /// True for a model whose outputs depend on the past.
    pub(crate) fn has_memory(&self) -> bool {
        self.now.session.has_memory()
    }

    /// Restores the state after instantiation.
    pub(crate) fn reset(&mut self) -> Result<(), String> {
        (self.now.inputs, self.now.begin_s) = (self.start, None);
        self.now.session.restart();
        self.outdate();
        self.move_to(0.0)
    }

    /// The present state.
    pub(crate) fn saved(&self) -> InstanceState {
        self.now.clone()
    }

    /// Returns to a state.
    pub(crate) fn restore(&mut self, saved: &InstanceState) {
        self.now.clone_from(saved);
        self.forget_parts();
    }

    /// Moves the time without a step.
    pub(crate) fn move_to(&mut self, time_s: f64) -> Result<(), String> {
        if !time_s.is_finite() {
            return Err(format!("expected a time in s, found {time_s}"));
        }
        self.now.time_s = time_s;
        Ok(())
    }

    /// Moves the time by a step, in which the inputs are constant. The first step of a model with memory begins at equilibrium.
    pub(crate) fn step(&mut self, from_s: f64, step_s: f64) -> Result<(), String> {
        if step_s.is_nan() || step_s < 0.0 {
            return Err(format!("expected a step forward in time, found {step_s} s from {from_s} s"));
        }
        let end_s = from_s + step_s;
        if !self.has_memory() || !end_s.is_finite() || step_s == 0.0 {
            return self.move_to(end_s);
        }
        let now = &mut self.now;
        let begin_s = now.begin_s.unwrap_or(from_s);
        let end_ns = ((end_s - begin_s) * 1e9).round().max(0.0) as u64;
        now.session.set_parameters(&now.inputs, &mut now.evaluation).map_err(|error| error.to_string())?;
        let stepped = now.session.step_held(end_ns, now.inputs, &mut now.evaluation);
        stepped.map_err(|error| match error {
            ReadingError::NotLater { .. } => {
                format!("expected a step to later than {} s, found {end_s} s", now.time_s)
            }
            ReadingError::NotFinite { .. } => error.to_string(),
        })?;
        (now.begin_s, now.is_current) = (Some(begin_s), true);
        self.forget_parts();
        self.move_to(end_s)
    }

    fn forget_parts(&mut self) {
        self.others.iter_mut().for_each(Part::forget);
        self.stress.iter_mut().for_each(Stress::forget);
    }

    /// Marks the answer as that of other inputs; between two steps of a model with memory it is that of the last one.
    fn outdate(&mut self) {
        self.now.is_current &= self.now.begin_s.is_some();
    }

    /// Sets an input. NaN, and infinity for inputs other than the gap, are refused, and the old value is kept.
    pub(crate) fn set(&mut self, reference: u32, value: f64) -> Result<(), String> {
        let input = reference.wrapping_sub(FIRST_INPUT) as usize;
        let key = self.keys.get(input).filter(|_| input < MAX_INPUTS);
        let key = key.ok_or_else(|| format!("value reference {reference} is no input"))?;
        if value.is_nan() || value.is_infinite() && input != GAP {
            return Err(format!("{key}: expected a number, found {value}; the value before stands"));
        }
        if self.now.inputs.values()[input] != value {
            self.now.inputs = self.now.inputs.with(input, value);
            self.outdate();
        }
        Ok(())
    }

    /// Evaluates the model where an input changed.
    fn update(&mut self) -> Result<(), String> {
        let now = &mut self.now;
        if !now.is_current {
            now.session
                .set_parameters(&now.inputs, &mut now.evaluation)
                .map_err(|error| error.to_string())?;
            now.session.evaluator().answer(now.inputs, Query::STATE, &mut now.evaluation);
            now.is_current = true;
            self.forget_parts();
        }
        if let Some(why) = self.now.session.evaluator().refusal(&self.now.evaluation) {
            return Err(why);
        }
        let regime = self.now.evaluation.regime;
        if !self.now.session.evaluator().has_regime(regime) {
            let name = regime.name();
            return Err(format!("this state belongs to regime {name}, in which the model was not trained"));
        }
        Ok(())
    }

    fn quantity(&self, reference: u32, integer: bool) -> Result<OutputQuantity, String> {
        let output = reference.wrapping_sub(FIRST_OUTPUT) as usize;
        let found = self.outputs.get(output).map(|output| output.quantity);
        let kind = if integer { "Int32" } else { "Float64" };
        found
            .filter(|quantity| quantity.is_integer() == integer)
            .ok_or_else(|| format!("value reference {reference} is no {kind} of this FMU"))
    }

    /// An input, the time or an output that is a Float64.
    pub(crate) fn float(&mut self, reference: u32) -> Result<f64, String> {
        if reference == TIME {
            return Ok(self.now.time_s);
        }
        let input = reference.wrapping_sub(FIRST_INPUT) as usize;
        if input < self.keys.len() {
            return Ok(self.now.inputs.values()[input]);
        }
        let quantity = self.quantity(reference, false)?;
        self.update()?;
        let found = &self.now.evaluation;
        Ok(match quantity {
            OutputQuantity::Number(at) => (NUMBERS[at].value)(found),
            OutputQuantity::ForceBy(input) => found.force_gradient[input],
            OutputQuantity::MaxStress => match &mut self.stress {
                Some(stress) => stress.largest_mpa(found)?.into(),
                None => f64::NAN,
            },
            OutputQuantity::AtNode { field, chosen } => {
                let stress = self.stress.iter_mut().map(|stress| &mut stress.part);
                for part in self.others.iter_mut().chain(stress) {
                    if let Some(value) = part.value(found, field, chosen)? {
                        return Ok(value.into());
                    }
                }
                return Err("no node was chosen".into());
            }
            OutputQuantity::Observable(at) => self.observed(at).map_or(f64::NAN, |found| found.value),
            OutputQuantity::ObservableHalfwidth(at) => {
                self.observed(at).map_or(f64::NAN, |found| found.halfwidth)
            }
        })
    }

    fn observed(&mut self, observable: usize) -> Option<Observed> {
        let part = self.others.as_mut()?;
        Some(self.observables.value(observable, part.at(&self.now.evaluation)))
    }

    /// An output that is an Int32.
    pub(crate) fn integer(&mut self, reference: u32) -> Result<i32, String> {
        let OutputQuantity::Number(at) = self.quantity(reference, true)? else {
            return Err("no Int32".into());
        };
        self.update()?;
        Ok((NUMBERS[at].value)(&self.now.evaluation) as i32)
    }
}

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
