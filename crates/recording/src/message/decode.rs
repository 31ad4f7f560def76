//! Payloads read back from their JSON form.

use serde::de::Error as _;
use serde_json::{Error, Map, Value};
use wire::{FieldHeader, SensorSample};

use super::field::values;
use wire::layout::{Codes, Field, Payload, Scalar, Show, field_id, pack_name};

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
