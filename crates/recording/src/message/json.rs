//! Payloads as JSON objects.

use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};
use serde_json::Value;
use wire::layout::{Codes, Field, Number, Show, View, field_id, hex, unpack_name};
use wire::{Answer, Payload};

/// A payload as a JSON object.
#[derive(Debug, Clone, Copy)]
pub struct Json<'a> {
    pub(super) view: View<'a>,
}

impl<'a> Json<'a> {
    /// JSON form of a payload.
    pub fn new(view: View<'a>) -> Self {
        Self { view }
    }
}

impl Serialize for Json<'_> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let mut map = to.serialize_map(None)?;
        properties(*self, &mut map)?;
        map.end()
    }
}

/// An answer as JSON; `refusal` is the reason for a refusal, or null.
pub fn answer(answer: &Answer) -> Value {
    // Numbers and strings only: serialisation cannot fail.
    let mut value = serde_json::to_value(Json::new(answer.view())).unwrap_or_default();
    value["refusal"] = answer.refusal().into();
    value
}

/// Writes the properties of a payload.
pub(super) fn properties<M: SerializeMap>(of: Json<'_>, to: &mut M) -> Result<(), M::Error> {
    for (key, field) in of.view.layout.json {
        to.serialize_entry(key, &Property { of, field })?;
    }
    Ok(())
}

struct Property<'a> {
    of: Json<'a>,
    field: &'a Field,
}

impl Serialize for Property<'_> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let Self { of: Json { view }, field } = self;
        let numbers = view.numbers(field).map(Digits);
        let whole = || view.wholes(field).next().unwrap_or(0) as u32;
        let used = |count: &str| view.whole(count).unwrap_or(0) as usize;
        match field.show {
            Show::Number if field.count == 1 => {
                Digits(view.numbers(field).next().unwrap_or(Number::Whole(0))).serialize(to)
            }
            Show::Number => to.collect_seq(numbers),
            Show::Counted(count) => to.collect_seq(numbers.take(used(count))),
            Show::UntilZero => to.collect_seq(view.wholes(field).take_while(|number| *number > 0)),
            Show::Hex if field.count == 1 => {
                to.collect_str(&format_args!("{:016x}", view.wholes(field).next().unwrap_or(0)))
            }
            Show::Hex => to.serialize_str(&hex(view.bytes(field))),
            Show::Name => to.serialize_str(&unpack_name(view.bytes(field))),
            Show::Flags(codes) => {
                let bits = whole();
                to.collect_seq(codes.iter().filter(|code| bits & code.number != 0).map(|code| code.name))
            }
            Show::Code(codes) => to.serialize_str(name(codes, whole())),
            Show::Codes(codes, count) => {
                to.collect_seq(view.wholes(field).take(used(count)).map(|number| name(codes, number as u32)))
            }
            Show::FieldNames => {
                let names = view.bytes(field).iter().map(|id| field_id::as_str(*id));
                to.collect_seq(names.take(used("field_count")))
            }
            Show::Names(count) => {
                let names = view.bytes(field).as_chunks::<32>().0.iter().take(used(count));
                to.collect_seq(names.map(|name| unpack_name(name)))
            }
            Show::PerCode(codes) => to.collect_map(
                view.numbers(field).map(Digits).zip(codes).map(|(number, code)| (code.name, number)),
            ),
        }
    }
}

fn name(codes: Codes, number: u32) -> &'static str {
    codes.iter().find(|code| code.number == number).map_or("unknown", |code| code.name)
}

/// A number in the shortest bit-identical form; null if it is NaN (absent), a string if it is infinite.
struct Digits(Number);

impl Serialize for Digits {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        match self.0 {
            Number::Whole(whole) => to.serialize_u64(whole),
            Number::Single(number) if number.is_finite() => to.serialize_f32(number),
            Number::Double(number) if number.is_finite() => to.serialize_f64(number),
            Number::Single(number) => not_finite(number.into(), to),
            Number::Double(number) => not_finite(number, to),
        }
    }
}

/// Infinite numbers have the spelling of protocol buffers' JSON.
fn not_finite<S: Serializer>(number: f64, to: S) -> Result<S::Ok, S::Error> {
    match number {
        f64::INFINITY => to.serialize_str("Infinity"),
        f64::NEG_INFINITY => to.serialize_str("-Infinity"),
        _ => to.serialize_unit(),
    }
}
