//! What the node says of itself and of its twins as parameters. All of them are read only.

use super::cdr::Cdr;
use super::config::Ros2;
use super::twins::Twins;
use wire::State;
use wire::layout::{hex, input_source};

/// Codes of `rcl_interfaces/ParameterType`.
pub const NOT_SET: u8 = 0;
const DOUBLE: u8 = 3;
const STRING: u8 = 4;
const DOUBLES: u8 = 8;
const STRINGS: u8 = 9;

/// A value.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// A number.
    Double(f64),
    /// A text.
    Text(String),
    /// Numbers.
    Doubles(Vec<f64>),
    /// Texts.
    Texts(Vec<String>),
}

impl Value {
    /// Its code of `ParameterType`.
    pub fn code(&self) -> u8 {
        match self {
            Self::Double(_) => DOUBLE,
            Self::Text(_) => STRING,
            Self::Doubles(_) => DOUBLES,
            Self::Texts(_) => STRINGS,
        }
    }

    /// Adds a `ParameterValue`; one that is not set when there is none.
    pub fn write(value: Option<&Self>, message: Cdr) -> Cdr {
        let (mut number, mut text, mut numbers, mut texts): (_, _, &[f64], &[String]) = (0.0, "", &[], &[]);
        match value {
            Some(Self::Double(value)) => number = *value,
            Some(Self::Text(value)) => text = value,
            Some(Self::Doubles(values)) => numbers = values,
            Some(Self::Texts(values)) => texts = values,
            None => {}
        }
        // Type, truth, whole number, number, text; lists of bytes, truths, whole numbers, numbers, texts.
        let message =
            message.byte(value.map_or(NOT_SET, Self::code)).byte(0).long(0).doubles(&[number]).text(text);
        message.word(0).word(0).word(0).word(numbers.len() as u32).doubles(numbers).texts(texts)
    }
}

/// A parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Name, parts separated by dots.
    pub name: String,
    /// Value.
    pub value: Value,
    /// What it is.
    pub description: String,
    /// Values that the model was trained over.
    pub range: Option<[f64; 2]>,
}

impl Parameter {
    fn new(name: impl Into<String>, value: Value, description: &str) -> Self {
        Self { name: name.into(), value, description: description.into(), range: None }
    }
}

/// All parameters at this moment.
pub fn all(ros: &Ros2, twins: &Twins) -> Vec<Parameter> {
    let names = twins.names().map(str::to_owned).collect();
    let version = Value::Text(env!("CARGO_PKG_VERSION").into());
    let mut found = vec![
        Parameter::new("version", version, "version of the gateway"),
        Parameter::new("actuators", Value::Texts(names), "actuators whose twins live"),
        Parameter::new("field_rate_hz", Value::Double(ros.field_rate_hz), "most fields a second of a topic"),
    ];
    for name in twins.names() {
        found.extend(twins.state(name).into_iter().flat_map(|state| of_twin(ros, name, state)));
    }
    found
}

/// The parameters of one actuator by its newest state.
pub fn of_twin(ros: &Ros2, actuator: &str, state: &State) -> Vec<Parameter> {
    let inputs: Vec<_> = state.inputs().collect();
    let names = inputs.iter().map(|input| input.name.clone()).collect();
    let mut found = vec![
        Parameter::new(
            format!("{actuator}.model_hash"),
            Value::Text(hex(&state.model_hash)),
            "first 16 bytes of the model file's hash",
        ),
        Parameter::new(
            format!("{actuator}.inputs"),
            Value::Texts(names),
            "inputs of the model, units at their end",
        ),
    ];
    let model = ros.models.iter().find(|model| model.hash == state.model_hash);
    if let Some(model) = model {
        let name = Value::Text(model.name.clone());
        found.push(Parameter::new(format!("{actuator}.model"), name, "the model's file, without its ending"));
    }
    for (at, input) in inputs.iter().enumerate() {
        let range = model.and_then(|model| model.inputs.get(at)?.range);
        let source = input_source::as_str(input.source);
        let description = format!("value of the newest state: {source}");
        let name = format!("{actuator}.input.{}", input.name);
        let value = Value::Double(input.value);
        found.push(Parameter { range, ..Parameter::new(name, value, &description) });
        if let Some(range) = range {
            let name = format!("{actuator}.range.{}", input.name);
            let value = Value::Doubles(range.to_vec());
            found.push(Parameter::new(
                name,
                value,
                "smallest and largest value that the model was trained over",
            ));
        }
    }
    found
}
