//! Whole fields, when asked for: a header to read and the values as they lay in memory.

use serde::Serialize;
use wire::FieldHeader;
use wire::layout::{field_id, flags, hex, regime, unpack_name};

use super::{Recorded, number, schema};

/// A field as JSON. Fields as in [`FieldHeader`]; `values` is base64 of little-endian `f32`, field-major, and left out
/// where the message goes beside the values themselves.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[allow(missing_docs)] // the wire's payload says what each is
pub struct FieldMessage {
    pub seq: u64,
    pub sensor_seq: u64,
    pub t_sensor_ns: u64,
    pub t_publish_ns: u64,
    #[serde(serialize_with = "number::serialize")]
    pub pressure_mpa: f64,
    #[serde(serialize_with = "number::serialize")]
    pub gap_mm: f64,
    pub regime: &'static str,
    #[serde(serialize_with = "number::serialize")]
    pub contact_force_n: f64,
    #[serde(serialize_with = "number::serialize")]
    pub max_von_mises_mpa: f64,
    pub max_von_mises_node: u32,
    pub flags: Vec<&'static str>,
    pub node_set: String,
    pub node_count: u32,
    pub fields: Vec<&'static str>,
    pub model_hash: String,
    pub boot_id: String,
    #[serde(skip_serializing_if = "String::is_empty")]
    pub values: String,
}

impl FieldMessage {
    /// The message of one received field. Cost: linear in the number of values (base64).
    pub fn new(header: &FieldHeader, values: &[f32]) -> Self {
        Self {
            seq: header.seq,
            sensor_seq: header.sensor_seq,
            t_sensor_ns: header.t_sensor_ns,
            t_publish_ns: header.t_publish_ns,
            pressure_mpa: header.pressure_mpa,
            gap_mm: header.gap_mm,
            regime: regime::as_str(header.regime),
            contact_force_n: header.contact_force_n,
            max_von_mises_mpa: header.max_von_mises_mpa,
            max_von_mises_node: header.max_von_mises_node,
            flags: flags::names(header.flags).collect(),
            node_set: unpack_name(&header.node_set),
            node_count: header.node_count,
            fields: header.fields().map(field_id::as_str).collect(),
            model_hash: hex(&header.model_hash),
            boot_id: format!("{:016x}", header.boot_id),
            values: base64(values.iter().flat_map(|value| value.to_le_bytes())),
        }
    }
}

/// The values of a recorded field's text; none when it is no base64 of whole numbers. `O(bytes)`.
pub fn field_values(text: &str) -> Option<Vec<f32>> {
    let digits = text.trim_end_matches('=').bytes().map(|byte| match byte {
        b'A'..=b'Z' => Some(byte - b'A'),
        b'a'..=b'z' => Some(byte - b'a' + 26),
        b'0'..=b'9' => Some(byte - b'0' + 52),
        b'+' => Some(62),
        b'/' => Some(63),
        _ => None,
    });
    let (mut bytes, mut word, mut bits) = (Vec::with_capacity(text.len() / 4 * 3), 0_u32, 0);
    for digit in digits {
        word = word << 6 | u32::from(digit?);
        bits += 6;
        if bits >= 8 {
            bits -= 8;
            bytes.push((word >> bits) as u8);
        }
    }
    let (numbers, rest) = bytes.as_chunks::<4>();
    rest.is_empty().then(|| numbers.iter().map(|b| f32::from_le_bytes(*b)).collect())
}

/// RFC 4648, section 4, with padding.
fn base64(bytes: impl Iterator<Item = u8>) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.size_hint().0.div_ceil(3) * 4);
    let mut bytes = bytes.peekable();
    while bytes.peek().is_some() {
        let group = [bytes.next(), bytes.next(), bytes.next()];
        let word = group.iter().fold(0u32, |word, byte| word << 8 | u32::from(byte.unwrap_or(0)));
        for place in 0..4 {
            let digit = DIGITS[(word >> (18 - 6 * place) & 63) as usize];
            // A missing second or third byte leaves the digits it alone would fill.
            let is_padding = place > 0 && group[place as usize - 1].is_none();
            text.push(if is_padding { '=' } else { char::from(digit) });
        }
    }
    text
}

impl Recorded for FieldMessage {
    const SCHEMA_NAME: &'static str = "softtwin.Field";

    fn schema_json() -> String {
        schema::object(
            Self::SCHEMA_NAME,
            &[
                ("seq", "integer", "counts up by one per field within a run of the twin"),
                ("sensor_seq", "integer", "number of the reading"),
                ("t_sensor_ns", "integer", "when that reading was taken, ns of the monotonic clock"),
                ("t_publish_ns", "integer", "when the field was sent, ns of the monotonic clock"),
                ("pressure_mpa", "number", "pressure of the reading, MPa"),
                ("gap_mm", "number", "gap of the reading, mm"),
                ("regime", "string", "free, contact or unknown"),
                ("contact_force_n", "number", "predicted contact force, N"),
                ("max_von_mises_mpa", "number", "largest von Mises stress in this sample, MPa"),
                ("max_von_mises_node", "integer", "node of that stress"),
                ("flags", "string[]", "set flags by name"),
                ("node_set", "string", "name of the node set"),
                ("node_count", "integer", "nodes in this sample"),
                ("fields", "string[]", "the fields in their order"),
                ("model_hash", "string", "first 16 bytes of the model file's hash, hexadecimal"),
                ("boot_id", "string", "the run of the twin, hexadecimal"),
                (
                    "values",
                    "base64",
                    "little-endian f32, all nodes of the first field, then of the second, ...",
                ),
            ],
        )
    }
}

#[cfg(test)]
mod tests {
    use super::{base64, field_values};

    #[test]
    fn values_come_back_to_the_bit() {
        for values in [vec![], vec![1.5_f32], vec![0.1, -2.0], vec![f32::MIN_POSITIVE, 3.0e8, -0.0]] {
            let text = base64(values.iter().flat_map(|v| v.to_le_bytes()));
            let back = field_values(&text).expect("our own text");
            assert_eq!(
                back.iter().map(|v| v.to_bits()).collect::<Vec<_>>(),
                values.iter().map(|v| v.to_bits()).collect::<Vec<_>>()
            );
        }
        assert_eq!(field_values("!!!!"), None);
        assert_eq!(field_values("Zm9v"), None, "three bytes are no number");
    }

    #[test]
    fn base64_gives_the_vectors_of_its_standard() {
        for (plain, coded) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(base64(plain.bytes()), coded);
        }
    }
}
