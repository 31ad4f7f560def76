//! Fields as messages: the header as JSON, the values as base64.

use base64::Engine;
use base64::engine::DecodePaddingMode;
use base64::engine::general_purpose::{GeneralPurpose, GeneralPurposeConfig, STANDARD};
use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};
use wire::{FieldHeader, Payload};

use super::{Json, Recorded, json, write};

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
        json::properties(Json::new(self.header.view()), &mut map)?;
        map.serialize_entry("values", &STANDARD.encode(bytes))?;
        map.end()
    }
}

impl Recorded for FieldMessage<'_> {
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

#[cfg(test)]
#[path = "../../tests/unit/message_field.rs"]
mod tests;
