//! The JSON form of payloads: one object each, with a JSON schema, both derived from the payload's layout.
//!
//! Numbers are read back bit-identical: finite ones have enough digits, NaN (absent) is null, the others are the strings
//! `"Infinity"` and `"-Infinity"`. Boot ids and hashes are hexadecimal strings, because many viewers keep only 53 bits of an integer.

use crate::writer::Channel;
use base64::Engine;
use base64::engine::DecodePaddingMode;
use base64::engine::general_purpose::{GeneralPurpose, GeneralPurposeConfig, STANDARD};
use serde::de::Error as _;
use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};
use serde_json::{Error, Map, Value, json};
use wire::layout::{
    Codes, Field, Layout, Number, Payload, Scalar, Show, View, field_id, hex, pack_name, unpack_name,
};
use wire::{Answer, Arrival, Arrivals, FieldHeader, SensorSample, Stamp};

/// A message of a recording.
pub trait EncodeJson {
    /// The message as JSON, into a reused buffer.
    fn encode(&self, out: &mut Vec<u8>);
}

/// The channel of a payload on `topic`.
pub fn channel(layout: &Layout, topic: &str) -> Channel {
    Channel { topic: topic.to_owned(), schema_name: layout.schema.to_owned(), schema: payload_schema(layout) }
}

impl EncodeJson for Json<'_> {
    fn encode(&self, out: &mut Vec<u8>) {
        write(self, out);
    }
}

impl EncodeJson for View<'_> {
    fn encode(&self, out: &mut Vec<u8>) {
        Json::new(*self).encode(out);
    }
}

/// Writing numbers and strings into memory cannot fail.
fn write(message: &impl Serialize, out: &mut Vec<u8>) {
    out.clear();
    let _ = serde_json::to_writer(out, message);
}

// ---- payloads read back from their JSON form ----

/// Reads a payload from its JSON form. An absent property keeps its default.
///
/// # Errors
/// Not a JSON object, or a property of the wrong kind.
pub fn decode<P: Payload>(data: &[u8]) -> Result<P, Error> {
    read(&serde_json::from_slice(data)?, &[])
}

/// Reads a reading, bit-identical to the written one. An invalid boot id becomes 0.
///
/// # Errors
/// As [`decode`]; also when number, stamp, pressure or gap is missing.
pub fn decode_reading(data: &[u8]) -> Result<SensorSample, Error> {
    read(&serde_json::from_slice(data)?, &["seq", "t_sensor_ns", "pressure_mpa", "gap_mm"])
}

/// Reads a field: its header, and its values field by field.
///
/// # Errors
/// As [`decode`]; also when the values are not base64 of the count in the header.
pub fn decode_field(data: &[u8]) -> Result<(FieldHeader, Vec<f32>), Error> {
    let properties: Map<String, Value> = serde_json::from_slice(data)?;
    let header: FieldHeader = read(&properties, &["node_count", "fields", "values"])?;
    let values = properties.get("values").and_then(Value::as_str).and_then(values);
    match values {
        Some(values) if values.len() as u64 == header.entries() => Ok((header, values)),
        _ => Err(Error::custom(format!(
            "`values`: expected base64 of {} numbers of 4 bytes",
            header.entries()
        ))),
    }
}

fn read<P: Payload>(properties: &Map<String, Value>, required: &[&str]) -> Result<P, Error> {
    if let Some(key) = required.iter().find(|key| !properties.contains_key(**key)) {
        return Err(Error::custom(format!("`{key}` is missing")));
    }
    let mut payload = P::default();
    for (key, field) in P::LAYOUT.json {
        if let Some(value) = properties.get(*key) {
            set(&mut payload, field, value)
                .ok_or_else(|| Error::custom(format!("`{key}` is {value}, expected {}", expected(field))))?;
        }
    }
    Ok(payload)
}

fn expected(field: &Field) -> &'static str {
    match field.show {
        Show::Number if matches!(field.scalar, Scalar::F32 | Scalar::F64) => {
            "a number, null, \"NaN\", \"Infinity\" or \"-Infinity\""
        }
        Show::Number => "an integer in range",
        Show::Hex | Show::Name | Show::Code(_) => "a string",
        Show::PerCode(_) => "an object",
        _ => "a list",
    }
}

/// Sets a field from its JSON form; `None` for the wrong kind.
fn set<P: Payload>(payload: &mut P, field: &Field, value: &Value) -> Option<()> {
    let strings = || value.as_array()?.iter().map(Value::as_str).collect::<Option<Vec<_>>>();
    match field.show {
        Show::Number if field.count == 1 => put(payload, field, 0, value)?,
        Show::Number | Show::UntilZero => list(payload, field, value.as_array()?)?,
        Show::Counted(count) => {
            list(payload, field, value.as_array()?)?;
            set_count(payload, count, value.as_array()?.len())?;
        }
        Show::Hex if field.count == 1 => {
            let run = u64::from_str_radix(value.as_str()?, 16).unwrap_or(0);
            put(payload, field, 0, &run.into())?;
        }
        Show::Hex => {
            let digits = value.as_str()?;
            let bytes =
                (0..digits.len() / 2).map(|at| u8::from_str_radix(digits.get(2 * at..2 * at + 2)?, 16).ok());
            list(payload, field, &bytes.map(|byte| byte.map(Value::from)).collect::<Option<Vec<_>>>()?)?;
        }
        Show::Name => {
            let name = pack_name(value.as_str()?);
            list(payload, field, &name.map(Value::from))?;
        }
        Show::Flags(codes) => {
            let bits =
                strings()?.iter().filter_map(|name| number(codes, name)).fold(0, |bits, bit| bits | bit);
            put(payload, field, 0, &bits.into())?;
        }
        Show::Code(codes) => {
            if let Some(number) = number(codes, value.as_str()?) {
                put(payload, field, 0, &number.into())?;
            }
        }
        Show::Codes(codes, _) => {
            let numbers = strings()?.into_iter().map(|name| number(codes, name).unwrap_or(0).into());
            list(payload, field, &numbers.collect::<Vec<Value>>())?;
        }
        Show::FieldNames => {
            let names = strings()?;
            let ids = names.iter().map(|name| field_id::from_name(name).unwrap_or(field_id::OTHER).into());
            list(payload, field, &ids.collect::<Vec<Value>>())?;
            set_count(payload, "field_count", names.len())?;
        }
        Show::Names(count) => {
            let names = strings()?;
            let bytes: Vec<Value> =
                names.iter().flat_map(|name| pack_name(name)).map(Value::from).take(field.count).collect();
            list(payload, field, &bytes)?;
            set_count(payload, count, names.len())?;
        }
        Show::PerCode(codes) => {
            for (name, value) in value.as_object()? {
                if let Some(index) = codes.iter().position(|code| code.name == name) {
                    put(payload, field, index, value)?;
                }
            }
        }
    }
    Some(())
}

fn number(codes: Codes, name: &str) -> Option<u32> {
    codes.iter().find(|code| code.name == name).map(|code| code.number)
}

fn list<P: Payload>(payload: &mut P, field: &Field, values: &[Value]) -> Option<()> {
    values.iter().enumerate().try_for_each(|(index, value)| put(payload, field, index, value))
}

fn set_count<P: Payload>(payload: &mut P, name: &str, count: usize) -> Option<()> {
    let field = P::LAYOUT.fields.iter().find(|field| field.name == name)?;
    put(payload, field, 0, &count.into())
}

/// Writes the number at `index` of a field.
fn put<P: Payload>(payload: &mut P, field: &Field, index: usize, value: &Value) -> Option<()> {
    let size = field.scalar.size();
    let slot = payload.bytes_mut().get_mut(field.range())?.chunks_exact_mut(size).nth(index)?;
    let integer = || value.as_u64();
    match field.scalar {
        Scalar::U8 => slot.copy_from_slice(&u8::try_from(integer()?).ok()?.to_le_bytes()),
        Scalar::U32 => slot.copy_from_slice(&u32::try_from(integer()?).ok()?.to_le_bytes()),
        Scalar::U64 => slot.copy_from_slice(&integer()?.to_le_bytes()),
        Scalar::F32 => slot.copy_from_slice(&(quantity(value)? as f32).to_le_bytes()),
        Scalar::F64 => slot.copy_from_slice(&quantity(value)?.to_le_bytes()),
    }
    Some(())
}

fn quantity(value: &Value) -> Option<f64> {
    match value {
        Value::Null => Some(f64::NAN),
        Value::Number(number) => number.as_f64(),
        Value::String(text) => match text.as_str() {
            "NaN" => Some(f64::NAN),
            "Infinity" => Some(f64::INFINITY),
            "-Infinity" => Some(f64::NEG_INFINITY),
            _ => None,
        },
        _ => None,
    }
}

// ---- fields as messages: the header as JSON, the values as base64 ----

/// A field as a message: the properties of its header, and `values` in base64.
#[derive(Debug, Clone, Copy)]
pub struct FieldMessage<'a> {
    header: &'a FieldHeader,
    values: &'a [f32],
}

impl<'a> FieldMessage<'a> {
    /// The message of one received field.
    pub fn new(header: &'a FieldHeader, values: &'a [f32]) -> Self {
        Self { header, values }
    }
}

impl Serialize for FieldMessage<'_> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let bytes: Vec<u8> = self.values.iter().flat_map(|value| value.to_le_bytes()).collect();
        let mut map = to.serialize_map(None)?;
        properties(Json::new(self.header.view()), &mut map)?;
        map.serialize_entry("values", &STANDARD.encode(bytes))?;
        map.end()
    }
}

impl EncodeJson for FieldMessage<'_> {
    fn encode(&self, out: &mut Vec<u8>) {
        write(self, out);
    }
}

/// Base64 with optional padding.
const LENIENT: GeneralPurpose = GeneralPurpose::new(
    &base64::alphabet::STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// Values of a recorded field; `None` if `text` is not base64 of a multiple of 4 bytes. `O(bytes)`.
pub(super) fn values(text: &str) -> Option<Vec<f32>> {
    let bytes = LENIENT.decode(text).ok()?;
    let (numbers, rest) = bytes.as_chunks::<4>();
    rest.is_empty().then(|| numbers.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect())
}

// ---- gaps in the sequence numbers of a topic, and the messages that note them in a recording ----

/// A jump in the sequence numbers of a topic: samples that are missing, or late.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SequenceGap {
    /// The number that was expected.
    pub expected_seq: u64,
    /// The number that came.
    pub found_seq: u64,
}

impl SequenceGap {
    /// Number of missing samples.
    pub fn missing(self) -> u64 {
        self.found_seq.saturating_sub(self.expected_seq)
    }
}

/// Follows the sequence numbers of one topic. A new publisher (another boot id) starts a new count.
#[derive(Debug, Default)]
pub struct GapCounter {
    last: Option<(u64, Arrivals)>,
}

/// Effect of a sample on the count of the missing ones.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct GapObservation {
    /// The gap in front of it, if there is one.
    pub gap: Option<SequenceGap>,
    /// Change of the number of missing samples: that of the gap, or -1 for one that was missing and came late.
    pub missing: i64,
}

impl GapCounter {
    pub fn observe(&mut self, stamp: Stamp) -> GapObservation {
        match &mut self.last {
            Some((boot_id, arrivals)) if *boot_id == stamp.boot_id => {
                let arrival = arrivals.take(stamp.seq);
                let gap = match arrival {
                    Arrival::New { missing } if missing > 0 => {
                        Some(SequenceGap { expected_seq: stamp.seq - missing, found_seq: stamp.seq })
                    }
                    _ => None,
                };
                GapObservation { gap, missing: arrival.lost() }
            }
            last => {
                *last = Some((stamp.boot_id, Arrivals::new(stamp.seq)));
                GapObservation::default()
            }
        }
    }
}

/// A gap as a message.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct GapMessage {
    pub topic: String,
    /// The number that was expected.
    pub expected_seq: u64,
    /// The number that came.
    pub found_seq: u64,
    /// Number of missing samples.
    pub missing: u64,
}

impl GapMessage {
    /// Where gaps are recorded.
    pub const TOPIC: &'static str = "softtwin/recorder/gap";

    /// The channel of these messages.
    pub fn channel() -> Channel {
        let name = "softtwin.Gap";
        let properties = [
            ("topic", "string", "The topic in which samples are missing."),
            ("expected_seq", "integer", "The number that was expected."),
            ("found_seq", "integer", "The number that came."),
            ("missing", "integer", "How many are missing."),
        ];
        let properties =
            properties.map(|(name, kind, meaning)| (name, json!({"type": kind, "description": meaning})));
        Channel {
            topic: Self::TOPIC.to_owned(),
            schema_name: name.to_owned(),
            schema: object_schema(name, properties),
        }
    }

    /// The message of one gap.
    pub fn new(topic: &str, gap: SequenceGap) -> Self {
        Self {
            topic: topic.to_owned(),
            expected_seq: gap.expected_seq,
            found_seq: gap.found_seq,
            missing: gap.missing(),
        }
    }
}

impl EncodeJson for GapMessage {
    fn encode(&self, out: &mut Vec<u8>) {
        write(self, out);
    }
}

// ---- payloads as JSON objects ----

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
pub(super) fn properties<M: SerializeMap>(payload: Json<'_>, to: &mut M) -> Result<(), M::Error> {
    for (key, field) in payload.view.layout.json {
        to.serialize_entry(key, &Property { payload, field })?;
    }
    Ok(())
}

struct Property<'a> {
    payload: Json<'a>,
    field: &'a Field,
}

impl Serialize for Property<'_> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let Self { payload: Json { view }, field } = self;
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

// ---- JSON schemas (draft 7), made from the payloads' descriptions ----

/// The schema of a payload's JSON form.
pub fn payload_schema(layout: &Layout) -> String {
    let mut properties: Vec<(&str, Value)> =
        layout.json.iter().map(|(key, field)| (*key, property(field))).collect();
    if layout == FieldHeader::LAYOUT {
        let description = "little-endian f32, all nodes of the first field, then of the second, ...";
        let values = json!({"type": "string", "contentEncoding": "base64", "description": description});
        properties.push(("values", values));
    }
    object_schema(layout.schema, properties)
}

/// The schema of an object with these properties.
pub fn object_schema<'a>(title: &str, properties: impl IntoIterator<Item = (&'a str, Value)>) -> String {
    let properties: Map<String, Value> =
        properties.into_iter().map(|(name, schema)| (name.to_owned(), schema)).collect();
    json!({
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": title,
        "type": "object",
        "properties": properties,
        "definitions": {
            "number": {"anyOf": [{"type": "number"}, {"enum": [null, "Infinity", "-Infinity"]}]},
        },
    })
    .to_string()
}

/// A number, null if NaN, or a string if infinite. A draft 7 validator follows `$ref` and ignores its siblings; viewers (Foxglove, Lichtblick)
/// read `type` and refuse a list of types.
fn number_schema(scalar: Scalar) -> Value {
    match scalar {
        Scalar::F32 | Scalar::F64 => json!({"type": "number", "$ref": "#/definitions/number"}),
        Scalar::U8 | Scalar::U32 | Scalar::U64 => json!({"type": "integer"}),
    }
}

fn property(field: &Field) -> Value {
    let strings = json!({"type": "array", "items": {"type": "string"}});
    let numbers = json!({"type": "array", "items": number_schema(field.scalar)});
    let mut schema = match field.show {
        Show::Number if field.count == 1 => number_schema(field.scalar),
        Show::Number | Show::Counted(_) | Show::UntilZero => numbers,
        Show::Hex | Show::Name | Show::Code(_) => json!({"type": "string"}),
        Show::Flags(_) | Show::Codes(..) | Show::FieldNames | Show::Names(_) => strings,
        Show::PerCode(codes) => {
            let counts: Map<String, Value> =
                codes.iter().map(|code| (code.name.to_owned(), number_schema(field.scalar))).collect();
            json!({"type": "object", "properties": counts})
        }
    };
    let unit = if field.unit.is_empty() { String::new() } else { format!(" Unit: {}.", field.unit) };
    schema["description"] = format!("{}{unit}", field.meaning.trim()).into();
    schema
}

#[cfg(test)]
#[path = "../tests/unit/message_field.rs"]
mod field_tests;

#[cfg(test)]
#[path = "../tests/unit/gaps.rs"]
mod gap_tests;
