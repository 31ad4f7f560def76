//! JSON schemas (draft 7), made from the payloads' descriptions.

use serde_json::{Map, Value, json};
use wire::FieldHeader;
use wire::layout::{Field, Layout, Payload, Scalar, Show};

/// The schema of a payload's JSON form.
pub fn of(layout: &Layout) -> String {
    let mut properties: Vec<(&str, Value)> =
        layout.json.iter().map(|(key, field)| (*key, property(field))).collect();
    if layout == FieldHeader::LAYOUT {
        let description = "little-endian f32, all nodes of the first field, then of the second, ...";
        let values = json!({"type": "string", "contentEncoding": "base64", "description": description});
        properties.push(("values", values));
    }
    object(layout.schema, properties)
}

/// The schema of an object with these properties.
pub fn object<'a>(title: &str, properties: impl IntoIterator<Item = (&'a str, Value)>) -> String {
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
fn number(scalar: Scalar) -> Value {
    match scalar {
        Scalar::F32 | Scalar::F64 => json!({"type": "number", "$ref": "#/definitions/number"}),
        Scalar::U8 | Scalar::U32 | Scalar::U64 => json!({"type": "integer"}),
    }
}

fn property(field: &Field) -> Value {
    let strings = json!({"type": "array", "items": {"type": "string"}});
    let numbers = json!({"type": "array", "items": number(field.scalar)});
    let mut schema = match field.show {
        Show::Number if field.count == 1 => number(field.scalar),
        Show::Number | Show::Counted(_) | Show::UntilZero => numbers,
        Show::Hex | Show::Name | Show::Code(_) => json!({"type": "string"}),
        Show::Flags(_) | Show::Codes(..) | Show::FieldNames | Show::Names(_) => strings,
        Show::PerCode(codes) => {
            let counts: Map<String, Value> =
                codes.iter().map(|code| (code.name.to_owned(), number(field.scalar))).collect();
            json!({"type": "object", "properties": counts})
        }
    };
    let unit = if field.unit.is_empty() { String::new() } else { format!(" Unit: {}.", field.unit) };
    schema["description"] = format!("{}{unit}", field.meaning.trim()).into();
    schema
}
