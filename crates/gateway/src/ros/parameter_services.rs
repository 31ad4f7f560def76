//! The services of `rcl_interfaces` through which others see a node's parameters. Setting is answered with a refusal.

use super::cdr::{Cdr, Reader};
use super::parameters::{NOT_SET, Parameter, Value};
use super::types::{
    DESCRIBE_PARAMETERS, GET_PARAMETER_TYPES, GET_PARAMETERS, LIST_PARAMETERS, MessageType, SET_PARAMETERS,
    SET_PARAMETERS_ATOMICALLY,
};

/// Names in one request.
const MAX_NAMES: usize = 1000;
/// Why a parameter is not set.
const READ_ONLY: &str = "read only";
/// What separates the parts of a name.
const SEPARATOR: char = '.';

/// One of the services.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// `list_parameters`.
    List,
    /// `get_parameters`.
    Get,
    /// `get_parameter_types`.
    Types,
    /// `describe_parameters`.
    Describe,
    /// `set_parameters`.
    Set,
    /// `set_parameters_atomically`, without which clients take the node for one without parameters.
    SetAtomically,
}

impl Access {
    /// All, as clients expect them of a node.
    pub const ALL: [Self; 6] =
        [Self::List, Self::Get, Self::Types, Self::Describe, Self::Set, Self::SetAtomically];

    /// Name behind the node's, and type.
    pub fn service(self) -> (&'static str, MessageType) {
        match self {
            Self::List => ("list_parameters", LIST_PARAMETERS),
            Self::Get => ("get_parameters", GET_PARAMETERS),
            Self::Types => ("get_parameter_types", GET_PARAMETER_TYPES),
            Self::Describe => ("describe_parameters", DESCRIBE_PARAMETERS),
            Self::Set => ("set_parameters", SET_PARAMETERS),
            Self::SetAtomically => ("set_parameters_atomically", SET_PARAMETERS_ATOMICALLY),
        }
    }

    /// Whether the answer depends on what the parameters are.
    pub fn needs_values(self) -> bool {
        !matches!(self, Self::Set | Self::SetAtomically)
    }

    /// The answer to a request.
    ///
    /// # Errors
    /// What is wrong with the request.
    pub fn answer(self, request: &[u8], parameters: &[Parameter]) -> Result<Vec<u8>, String> {
        let answer = match self {
            Self::List => list_request(request).map(|(prefixes, depth)| list(parameters, &prefixes, depth)),
            Self::Get | Self::Types | Self::Describe => names_request(request).map(|names| {
                let found: Vec<(&str, Option<&Parameter>)> = names
                    .into_iter()
                    .map(|name| (name, parameters.iter().find(|parameter| parameter.name == name)))
                    .collect();
                match self {
                    Self::Get => values(&found),
                    Self::Types => types(&found),
                    _ => descriptors(&found),
                }
            }),
            Self::Set => set_request(request).map(refused_each),
            Self::SetAtomically => set_request(request).map(|_| refused(Cdr::new()).finish()),
        };
        let (name, _) = self.service();
        answer.ok_or_else(|| {
            format!("expected a request to {name} of at most {MAX_NAMES} names in little-endian CDR")
        })
    }
}

/// Prefixes and depth.
fn list_request(request: &[u8]) -> Option<(Vec<&str>, u64)> {
    let mut reader = Reader::new(request)?;
    Some((reader.texts(MAX_NAMES)?, reader.long()?))
}

fn names_request(request: &[u8]) -> Option<Vec<&str>> {
    Reader::new(request)?.texts(MAX_NAMES)
}

/// How many parameters are to be set; their values are of no interest.
fn set_request(request: &[u8]) -> Option<usize> {
    let mut reader = Reader::new(request)?;
    let count = reader.word()? as usize;
    if count > MAX_NAMES {
        return None;
    }
    for _ in 0..count {
        reader.text()?;
        // Type, truth, whole number, number, text; lists of bytes, truths, whole numbers, numbers, texts.
        reader.byte()?;
        reader.byte()?;
        reader.long()?;
        reader.double()?;
        reader.text()?;
        for size in [1, 1, 8, 8] {
            reader.skip_list(size)?;
        }
        reader.texts(MAX_NAMES)?;
    }
    Some(count)
}

/// Names below the prefixes, at most so many parts deep (0: all), and what stands before their last parts.
fn list(parameters: &[Parameter], prefixes: &[&str], depth: u64) -> Vec<u8> {
    let is_shallow = |rest: &str| depth == 0 || (rest.matches(SEPARATOR).count() as u64) < depth;
    let is_below = |name: &str, prefix: &str| {
        let rest = name.strip_prefix(prefix).and_then(|rest| rest.strip_prefix(SEPARATOR));
        name == prefix || rest.is_some_and(is_shallow)
    };
    let is_listed = |name: &&str| match prefixes {
        [] => is_shallow(name),
        _ => prefixes.iter().any(|prefix| is_below(name, prefix)),
    };
    let names: Vec<&str> =
        parameters.iter().map(|parameter| parameter.name.as_str()).filter(is_listed).collect();
    let mut above: Vec<&str> =
        names.iter().filter_map(|name| name.rsplit_once(SEPARATOR)).map(|(above, _)| above).collect();
    above.sort_unstable();
    above.dedup();
    Cdr::new().texts(&names).texts(&above).finish()
}

fn values(found: &[(&str, Option<&Parameter>)]) -> Vec<u8> {
    let message = Cdr::new().word(found.len() as u32);
    let value = |message, (_, parameter): &(&str, Option<&Parameter>)| {
        Value::write(parameter.map(|parameter| &parameter.value), message)
    };
    found.iter().fold(message, value).finish()
}

fn types(found: &[(&str, Option<&Parameter>)]) -> Vec<u8> {
    let code =
        |(_, parameter): &(&str, Option<&Parameter>)| parameter.map_or(NOT_SET, |one| one.value.code());
    Cdr::new().bytes(&found.iter().map(code).collect::<Vec<u8>>()).finish()
}

fn descriptors(found: &[(&str, Option<&Parameter>)]) -> Vec<u8> {
    let message = Cdr::new().word(found.len() as u32);
    found.iter().fold(message, |message, (name, parameter)| descriptor(message, name, *parameter)).finish()
}

/// A `ParameterDescriptor`; of an unknown parameter its name only.
fn descriptor(message: Cdr, name: &str, parameter: Option<&Parameter>) -> Cdr {
    let code = parameter.map_or(NOT_SET, |parameter| parameter.value.code());
    let description = parameter.map_or("", |parameter| &parameter.description);
    // Name, type, description, further constraints, read only, no other types.
    let is_read_only = u8::from(parameter.is_some());
    let message = message.text(name).byte(code).text(description).text("").byte(is_read_only).byte(0);
    // Ranges of numbers (from, to, any step) and of whole numbers.
    let message = match parameter.and_then(|parameter| parameter.range) {
        Some([low, high]) => message.word(1).doubles(&[low, high, 0.0]),
        None => message.word(0),
    };
    message.word(0)
}

fn refused(message: Cdr) -> Cdr {
    message.byte(0).text(READ_ONLY)
}

fn refused_each(count: usize) -> Vec<u8> {
    (0..count).fold(Cdr::new().word(count as u32), |message, _| refused(message)).finish()
}

#[cfg(test)]
#[path = "../../tests/unit/parameter_services.rs"]
mod tests;
