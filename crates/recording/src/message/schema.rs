//! Builds the JSON schemas from tables of (property, type, description).

use serde_json::{Map, Value, json};

/// A flat object. `kind` is a JSON type, `number[]` for an array of numbers, `string[]` for one of texts, or `base64`.
pub fn object(title: &str, properties: &[(&str, &str, &str)]) -> String {
    let properties: Map<String, Value> = properties
        .iter()
        .map(|(name, kind, description)| ((*name).to_owned(), property(kind, description)))
        .collect();
    json!({"title": title, "type": "object", "properties": properties}).to_string()
}

fn property(kind: &str, description: &str) -> Value {
    if let Some(items) = kind.strip_suffix("[]") {
        return json!({"type": "array", "items": {"type": items}, "description": description});
    }
    match kind {
        "base64" => json!({"type": "string", "contentEncoding": "base64", "description": description}),
        kind => json!({"type": kind, "description": description}),
    }
}
