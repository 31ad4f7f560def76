//! Messages for the page: a JSON header, then numbers.
//!
//! Layout of a binary message: `u32` length of the header, the header as JSON, zeros up to a multiple of four, then
//! little-endian 32-bit numbers.

use rom::evaluation::{Evaluation, NUMBERS};
use rom::evaluator::Evaluator;
use rom::hull::DomainStatus;
use rom::inputs::InputSpec;
use serde::Serialize;
use serde_json::{Map, Value};

/// Header and numbers as one message. `O(numbers)`.
pub fn encode(header: &impl Serialize, parts: &[&[u32]]) -> Vec<u8> {
    let json = serde_json::to_vec(header).unwrap_or_default(); // plain structs of ours always serialise
    let start = (4 + json.len()).next_multiple_of(4);
    let mut bytes = Vec::with_capacity(start + 4 * parts.iter().map(|part| part.len()).sum::<usize>());
    bytes.extend((json.len() as u32).to_le_bytes());
    bytes.extend(&json);
    bytes.resize(start, 0);
    for part in parts {
        bytes.extend(part.iter().flat_map(|bits| bits.to_le_bytes()));
    }
    bytes
}

/// Floats as the bits that [`encode`] takes.
pub fn bits(values: impl Iterator<Item = f32>) -> Vec<u32> {
    values.map(f32::to_bits).collect()
}

/// A number as recordings and the live view write it: NaN (not known) is null, an infinite one a word.
fn number(value: f64) -> Value {
    if value.is_infinite() {
        return Value::from(if value > 0.0 { "Infinity" } else { "-Infinity" });
    }
    Value::from(value)
}

/// The part of a frame's header that describes the values behind it, `fields x count`, field-major.
#[derive(Clone, Debug, Serialize)]
pub struct Shape {
    /// Number of the model whose mesh belongs to the nodes; none: nodes without a known surface.
    pub model: Option<usize>,
    /// Names of the fields.
    pub fields: Vec<&'static str>,
    /// Nodes per field.
    pub count: usize,
    /// Largest von Mises stress, MPa.
    pub max_von_mises_mpa: f64,
    /// The model's node with that stress.
    pub max_von_mises_node: Option<u32>,
}

impl Shape {
    /// No values.
    pub const EMPTY: Self = Self {
        model: None,
        fields: Vec::new(),
        count: 0,
        max_von_mises_mpa: f64::NAN,
        max_von_mises_node: None,
    };
}

/// Header of a predicted frame: the numbers have the names that they have in a `softtwin.State`.
#[derive(Serialize)]
pub(crate) struct PredictionHead<'a> {
    kind: &'static str,
    actuator: &'static str,
    predicted: bool,
    playing: bool,
    t_s: Option<f64>,
    #[serde(flatten)]
    shape: &'a Shape,
    regime: &'static str,
    flags: Vec<&'static str>,
    input_names: Vec<String>,
    inputs: Vec<Value>,
    force_by_input: Vec<Value>,
    pressure_mpa: Value,
    gap_mm: Value,
    #[serde(flatten)]
    numbers: Map<String, Value>,
}

impl<'a> PredictionHead<'a> {
    pub(crate) fn new(
        actuator: &'static str,
        evaluator: &Evaluator,
        e: &Evaluation,
        shape: &'a Shape,
    ) -> Self {
        let inputs = evaluator.inputs();
        let of_inputs = |values: &[f64]| values.iter().take(inputs.len()).copied().map(number).collect();
        let numbers = NUMBERS.iter().filter(|number| number.key != "regime" && number.key != "domain_status");
        Self {
            kind: "frame",
            actuator,
            predicted: true,
            playing: false,
            t_s: None,
            shape,
            regime: e.regime.name(),
            flags: flags(e),
            input_names: inputs.iter().map(InputSpec::key).collect(),
            inputs: of_inputs(e.inputs.values()),
            force_by_input: of_inputs(&e.force_gradient),
            pressure_mpa: number(e.inputs.pressure_mpa()),
            gap_mm: number(e.inputs.gap_mm()),
            numbers: numbers.map(|entry| (entry.key.to_owned(), number((entry.value)(e)))).collect(),
        }
    }
}

/// Warnings about a prediction, by the names that they have in a `softtwin.State`.
pub(crate) fn flags(e: &Evaluation) -> Vec<&'static str> {
    let all = [
        ("near-edge", e.domain == DomainStatus::Near),
        ("outside-domain", e.domain == DomainStatus::Outside),
        ("force-clamped", e.flags.force_clamped),
        ("snapped", e.flags.snapped),
        ("branch-unknown", e.flags.branch_unknown),
    ];
    all.into_iter().filter(|(_, is_set)| *is_set).map(|(name, _)| name).collect()
}
