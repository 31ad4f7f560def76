//! Queries of a twin: state, pressure or gap. Their types are defined in clients/ros2/softtwin_interfaces.

use super::cdr::{Cdr, Reader};
use super::types::{FIND_GAP, FIND_PRESSURE, MessageType, WHAT_IF};
use wire::layout::{InputValue, PARAMETERS_MAX, field_id, flags, hex, pack_name, query_kind, regime};
use wire::{Answer, Query, Topic};

/// Largest number of parameters in one request, above that of any model.
const MAX_NAMES: usize = 64;

/// Kind of a query.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Question {
    /// The state at a pressure and a gap.
    WhatIf,
    /// The pressure of a force.
    Pressure,
    /// The gap of a force.
    Gap,
}

impl Question {
    pub const ALL: [Self; 3] = [Self::WhatIf, Self::Pressure, Self::Gap];

    /// Name of the service after the actuator's, and type.
    pub fn service(self) -> (&'static str, MessageType) {
        match self {
            Self::WhatIf => ("what_if", WHAT_IF),
            Self::Pressure => ("find_pressure", FIND_PRESSURE),
            Self::Gap => ("find_gap", FIND_GAP),
        }
    }

    /// The query in a request; the inner `Err` is the reason for a negative response.
    ///
    /// # Errors
    /// Malformed requests.
    pub fn read(self, request: &[u8]) -> Result<Result<Query, String>, String> {
        let (name, _) = self.service();
        self.parts(request).ok_or_else(|| {
            format!("expected a request to {name} of at most {MAX_NAMES} parameters in little-endian CDR")
        })
    }

    fn parts(self, request: &[u8]) -> Option<Result<Query, String>> {
        let mut reader = Reader::new(request)?;
        let mut number = || reader.double();
        let query = match self {
            Self::WhatIf => Query {
                kind: query_kind::WHATIF,
                pressure_mpa: number()?,
                gap_mm: number()?,
                ..Query::default()
            },
            Self::Pressure => Query {
                kind: query_kind::PRESSURE,
                force_n: number()?,
                gap_mm: number()?,
                ..Query::default()
            },
            Self::Gap => Query {
                kind: query_kind::GAP,
                pressure_mpa: number()?,
                force_n: number()?,
                force_halfwidth_n: number()?,
                ..Query::default()
            },
        };
        let names = reader.strings(MAX_NAMES)?;
        let values = reader.doubles(MAX_NAMES)?;
        let node_set = reader.string()?;
        Some(completed(query, &names, &values, node_set))
    }
}

/// The query with parameters and node set.
fn completed(mut query: Query, names: &[&str], values: &[f64], node_set: &str) -> Result<Query, String> {
    if names.len() != values.len() {
        let (names, values) = (names.len(), values.len());
        return Err(format!("expected as many parameters as parameter_names, found {values} and {names}"));
    }
    for (name, value) in names.iter().zip(values) {
        if !query.set_parameter(name, *value) {
            return Err(format!("expected at most {PARAMETERS_MAX} parameters, found {}", names.len()));
        }
    }
    if !node_set.is_empty() {
        if Topic::field("any", Some(node_set)).is_err() {
            return Err(format!("expected the name of a node set in node_set, found {node_set:?}"));
        }
        (query.want_field, query.node_set) = (1, pack_name(node_set));
    }
    Ok(query)
}

/// The response with an answer of the twin and the field behind it.
pub fn response(answer: &Answer, field: &[f32]) -> Vec<u8> {
    match answer.refusal() {
        None => written(true, "", answer, field),
        Some(reason) => written(false, &reason, answer, &[]),
    }
}

/// The negative response with its reason.
pub fn refusal(reason: &str) -> Vec<u8> {
    written(false, reason, &Answer::default(), &[])
}

/// A response: success and message, then `softtwin_interfaces/Answer`.
fn written(is_success: bool, message: &str, answer: &Answer, field: &[f32]) -> Vec<u8> {
    let inputs: Vec<InputValue> = answer.inputs().collect();
    let names: Vec<&str> = inputs.iter().map(|input| input.name.as_str()).collect();
    let list = |message: Cdr, of: fn(&InputValue) -> f64| {
        let values: Vec<f64> = inputs.iter().map(of).collect();
        message.word(values.len() as u32).doubles(&values)
    };
    let message = Cdr::new().byte(u8::from(is_success)).string(message);
    let message = message.doubles(&[answer.pressure_mpa, answer.gap_mm]).strings(&names);
    let message = list(message, |input| input.value).string(regime::as_str(answer.regime));
    let message = message.byte(answer.domain_status as u8).doubles(&[
        answer.domain_distance.into(),
        answer.contact_force_n,
        answer.force_halfwidth_n.into(),
    ]);
    let message = list(message, |input| input.force_by).doubles(&[
        answer.onset_pressure_mpa,
        answer.displacement_halfwidth_mm.into(),
        answer.von_mises_halfwidth_mpa.into(),
        answer.uncertainty,
        answer.low,
        answer.high,
    ]);
    let has_field = !field.is_empty();
    let fields: Vec<&str> = answer.fields().filter(|_| has_field).map(field_id::as_str).collect();
    let nodes = if has_field { answer.node_count } else { 0 };
    let message = message.strings(&fields).word(nodes).word(field.len() as u32).floats(field);
    let set: Vec<&str> = flags::names(answer.flags).collect();
    let message = message.doubles(&[answer.max_von_mises_mpa]).word(answer.max_von_mises_node);
    message.strings(&set).string(&hex(&answer.model_hash)).finish()
}

#[cfg(test)]
#[path = "../../tests/unit/question.rs"]
mod tests;
