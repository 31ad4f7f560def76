//! Cost of a scene before it runs: loaded blocks, bytes, and measured microseconds per sample.

use crate::latency;
use crate::load::{self, LoadedActuator};
use rom::evaluator::Query;
use rom::inputs::{InputSpec, Inputs};
use rom::snapshots::RegimeKind;
use serde::Serialize;
use std::fmt;
use std::time::Instant;
use wire::layout::input_source;
use wire::{Topic, TopicKind, qos};

/// One actuator of a scene, explained.
#[derive(Debug, Clone, Serialize)]
pub struct Explained {
    pub actuator: String,
    /// Gaps that can occur, mm.
    pub gap_mm: (f64, f64),
    /// The model's parameters and the values they have here.
    pub inputs: Vec<ExplainedInput>,
    /// Regimes that can occur with these gaps.
    pub regimes: Vec<&'static str>,
    /// Bytes read from the model file.
    pub read_bytes: u64,
    /// Bytes of all blocks in the model file: the difference was never touched.
    pub file_block_bytes: u64,
    pub blocks: usize,
    /// Evaluation alone (coefficients, force, gradients, half-widths): median microseconds.
    pub state_us: f64,
    pub outputs: Vec<ExplainedOutput>,
}

/// One parameter of the model, explained.
#[derive(Debug, Clone, Serialize)]
pub struct ExplainedInput {
    pub name: String,
    pub unit: String,
    /// Value used; `None` if it comes with the readings.
    pub value: Option<f64>,
    /// `given` by the scene, `measured`, `estimated` (the value is its prior) or the model's `nominal` one.
    pub from: &'static str,
}

/// `load_n measured`, `elastomer.law.mu_mpa = 0.72 MPa (given)`.
impl fmt::Display for ExplainedInput {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.value {
            Some(value) => write!(f, "{} = {value} {} ({})", self.name, self.unit, self.from),
            None => write!(f, "{} {}", self.name, self.from),
        }
    }
}

/// One field topic, explained.
#[derive(Debug, Clone, Serialize)]
pub struct ExplainedOutput {
    pub topic: String,
    /// Nodes of a sample.
    pub nodes: usize,
    /// Fields of a sample.
    pub fields: Vec<String>,
    /// Bytes of the basis in memory, of all regimes.
    pub basis_bytes: u64,
    /// Bytes of it that a sample is made from, at most.
    pub most_read_bytes: u64,
    /// Bytes of one sample on the wire.
    pub sample_bytes: u64,
    /// Shared memory reserved for the topic.
    pub reserved_bytes: u64,
    /// Evaluation and reconstruction: median microseconds.
    pub us: f64,
}

/// Evaluations timed for each median.
const ROUNDS: usize = 200;

/// Measures one actuator, in the regime that costs most of those that can occur.
pub fn explain(loaded: &LoadedActuator) -> Explained {
    let state = Inputs::new(0.03, costly_gap_mm(loaded));
    let mut evaluation = loaded.session.evaluator().evaluation();
    let carried = loaded.spec.state.coefficients;
    let state_us = median_us(|| {
        let query = if carried { Query::COEFFICIENTS } else { Query::STATE };
        loaded.session.evaluator().answer(state, query, &mut evaluation);
    });
    let actuator = loaded.spec.name.clone();
    let outputs = loaded
        .outputs
        .iter()
        .map(|output| {
            let mut values = vec![0.0; output.reconstructor.entries()];
            let us = median_us(|| {
                loaded.session.evaluator().evaluate(state, &mut evaluation);
                output.reconstructor.reconstruct_into(&evaluation, &mut values)
            });
            let sample_bytes = 4 * values.len() as u64;
            let topic = Topic::field(&actuator, output.spec.topic_name());
            ExplainedOutput {
                topic: topic.map(|topic| topic.to_string()).unwrap_or_default(),
                nodes: output.reconstructor.rows(),
                fields: output.fields.clone(),
                basis_bytes: output.basis_bytes,
                most_read_bytes: output.most_read_bytes,
                sample_bytes,
                reserved_bytes: sample_bytes * qos::of(TopicKind::Field).samples_in_use() as u64,
                us,
            }
        })
        .collect();
    Explained {
        actuator,
        gap_mm: loaded.spec.gap_mm.range_mm(),
        inputs: inputs(loaded),
        regimes: loaded.regime_names(),
        read_bytes: loaded.read.iter().map(|block| block.bytes).sum(),
        file_block_bytes: loaded.file_block_bytes,
        blocks: loaded.read.len(),
        state_us,
        outputs,
    }
}

/// The parameters with their values, in the model's order.
pub fn inputs(loaded: &LoadedActuator) -> Vec<ExplainedInput> {
    let explained = |(index, spec): (usize, &InputSpec)| {
        let (value, source) = (spec.value?, load::input_source_of(&loaded.spec, index, spec));
        let prior = loaded.spec.estimate.get(&spec.name).map(|unknown| unknown.prior);
        let (name, unit, from) = (spec.name.clone(), spec.unit.clone(), input_source::as_str(source));
        let value = (source != input_source::MEASURED).then_some(prior.unwrap_or(value));
        Some(ExplainedInput { name, unit, value, from })
    };
    loaded.session.evaluator().taken_inputs().filter_map(explained).collect()
}

/// A gap at which the costliest regime of the scene is evaluated: contact where it can occur.
fn costly_gap_mm(loaded: &LoadedActuator) -> f64 {
    let (min_mm, max_mm) = loaded.spec.gap_mm.range_mm();
    if loaded.regimes.contains(&RegimeKind::Contact) { min_mm } else { max_mm.min(1e6) }
}

fn median_us<R>(mut call: impl FnMut() -> R) -> f64 {
    let mut histogram = latency::histogram();
    for _ in 0..ROUNDS {
        let begin = Instant::now();
        std::hint::black_box(call());
        histogram.saturating_record(begin.elapsed().as_nanos() as u64);
    }
    histogram.value_at_quantile(0.5) as f64 / 1000.0
}
