//! The payloads and codes of the wire as tables, from which the package makes its structures.

use crate::refused;
use pyo3::prelude::*;
use wire::layout::{
    Codes, Field, LAYOUT_VERSION, PAYLOADS, Show, domain_status, field_id, flags, query_kind, regime,
};
use wire::{QueryStatus, Topic};

/// Name, type on the wire, meaning, and fields: name, type of a value, values, how it is shown, names of its numbers.
type Structure = (&'static str, &'static str, &'static str, Vec<FieldRow>);
type FieldRow =
    (&'static str, &'static str, usize, (&'static str, Option<&'static str>), Vec<(u32, &'static str)>);

/// All payloads in order, for structures of the same bytes.
#[pyfunction]
pub fn layouts() -> (u32, Vec<Structure>) {
    let structures = PAYLOADS.iter().map(|layout| {
        let fields = layout.fields.iter().map(|field| {
            let (show, codes) = shown(field);
            (field.name, field.scalar.as_str(), field.count, show, named(codes))
        });
        (layout.name, layout.type_name, layout.meaning, fields.collect())
    });
    (LAYOUT_VERSION, structures.collect())
}

/// How a field is shown, with the field of its length, and its codes.
fn shown(field: &Field) -> ((&'static str, Option<&'static str>), Codes) {
    match field.show {
        Show::Hex => (("hex", None), &[]),
        Show::Name => (("name", None), &[]),
        Show::Names(count) => (("names", Some(count)), &[]),
        Show::Flags(codes) => (("flags", None), codes),
        Show::Code(codes) => (("code", None), codes),
        Show::Codes(codes, count) => (("codes", Some(count)), codes),
        Show::Number | Show::Counted(_) | Show::UntilZero | Show::FieldNames | Show::PerCode(_) => {
            (("number", None), &[])
        }
    }
}

fn named(codes: Codes) -> Vec<(u32, &'static str)> {
    codes.iter().map(|code| (code.number, code.name)).collect()
}

/// Names of numbers by their kind, for those that are not of a payload's field alone.
#[pyfunction]
pub fn codes(kind: &str) -> PyResult<Vec<(u32, &'static str)>> {
    let codes = match kind {
        "fields" => field_id::ALL,
        "regimes" => regime::ALL,
        "domain statuses" => domain_status::ALL,
        "flags" => flags::ALL,
        "queries" => query_kind::ALL,
        "query statuses" => QueryStatus::CODES,
        _ => return Err(refused(format!("no codes of that kind: {kind}"))),
    };
    Ok(named(codes))
}

/// The kind of a topic, such as `state`.
#[pyfunction]
pub fn kind_of(topic: &str) -> PyResult<&'static str> {
    Ok(parsed(topic)?.kind().as_str())
}

/// The topic of a whole name.
pub fn parsed(topic: &str) -> PyResult<Topic> {
    Topic::parse(topic).ok_or_else(|| {
        refused(format!(
            "`{topic}`: expected softtwin/<actuator>/sensor, /state, /health, /estimate, /command, /target, /field or /field/<set>, /setpoint, /override or \
             /valve, alone or with a cavity, or softtwin/<scene>/grasp, without wildcards"
        ))
    })
}
