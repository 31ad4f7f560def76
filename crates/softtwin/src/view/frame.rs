//! What travels to the page: a JSON header, then numbers.
//!
//! Layout of a binary message: `u32` length of the header, the header as JSON, zeros up to a multiple of four, then
//! little-endian 32-bit numbers. Values that are not known are `null`.

use serde::Serialize;
use std::borrow::Cow;
use wire::layout::{field_id, flags, regime};

/// A name: a fixed one from shared memory, or one out of a recording.
pub type Word = Cow<'static, str>;

/// Header of one frame of one actuator; the numbers behind it are `fields x count`, field-major `f32`.
#[derive(Clone, Debug, Serialize)]
pub struct FrameHead {
    /// `"frame"`.
    pub kind: &'static str,
    /// Name of the actuator.
    pub actuator: String,
    /// Number of the model whose mesh belongs to the nodes; none: nodes without a known surface.
    pub model: Option<usize>,
    /// True for an answer to "what if".
    pub predicted: bool,
    /// Sequence number of the field on the wire.
    pub seq: u64,
    /// Names of the fields behind the header.
    pub fields: Vec<Word>,
    /// Nodes a field.
    pub count: usize,
    /// Pressure, MPa.
    pub pressure_mpa: f64,
    /// Gap, mm.
    pub gap_mm: f64,
    /// Contact force, N.
    pub contact_force_n: f64,
    /// Measured contact force, N.
    pub measured_force_n: f64,
    /// Pressure of first contact, MPa; null: out of reach.
    pub onset_pressure_mpa: f64,
    /// Half width of the force's error bar, N.
    pub force_halfwidth_n: f32,
    /// Half width of the displacement's error bar, mm.
    pub displacement_halfwidth_mm: f32,
    /// Half width of the stress's error bar, MPa.
    pub von_mises_halfwidth_mpa: f32,
    /// Largest von Mises stress, MPa.
    pub max_von_mises_mpa: f64,
    /// The model's node with that stress.
    pub max_von_mises_node: Option<u32>,
    /// Regime for people.
    pub regime: Word,
    /// Names of the set flags.
    pub flags: Vec<Word>,
    /// What became of the newest reading.
    pub outcome: Word,
    /// From sensor stamp to published, ms.
    pub latency_ms: f64,
    /// Readings a second.
    pub rate_hz: f64,
    /// Place in the recording, s; null: live.
    pub t_s: f64,
    /// Whether a recording is running.
    pub playing: bool,
}

impl FrameHead {
    /// A header in which nothing is known.
    pub fn empty(actuator: &str) -> Self {
        Self {
            kind: "frame",
            actuator: actuator.to_owned(),
            model: None,
            predicted: false,
            seq: 0,
            fields: Vec::new(),
            count: 0,
            pressure_mpa: f64::NAN,
            gap_mm: f64::NAN,
            contact_force_n: f64::NAN,
            measured_force_n: f64::NAN,
            onset_pressure_mpa: f64::NAN,
            force_halfwidth_n: f32::NAN,
            displacement_halfwidth_mm: f32::NAN,
            von_mises_halfwidth_mpa: f32::NAN,
            max_von_mises_mpa: f64::NAN,
            max_von_mises_node: None,
            regime: regime::as_str(regime::UNKNOWN).into(),
            flags: Vec::new(),
            outcome: Word::default(),
            latency_ms: f64::NAN,
            rate_hz: f64::NAN,
            t_s: f64::NAN,
            playing: false,
        }
    }

    /// Takes what the header of a field says.
    pub fn set_field(&mut self, header: &wire::FieldHeader) {
        self.seq = header.seq;
        self.pressure_mpa = header.pressure_mpa;
        self.gap_mm = header.gap_mm;
        self.contact_force_n = header.contact_force_n;
        self.max_von_mises_mpa = header.max_von_mises_mpa;
        self.regime = regime::as_str(header.regime).into();
        self.flags = flags::names(header.flags).map(Word::from).collect();
        self.latency_ms = header.t_publish_ns.saturating_sub(header.t_sensor_ns) as f64 * 1e-6;
        self.fields = header.fields().map(field_id::as_str).map(Word::from).collect();
    }

    /// Takes what a recording says of a state.
    pub fn set_recorded(&mut self, state: &crate::recording_data::RecordedState) {
        self.seq = state.seq;
        self.pressure_mpa = state.pressure_mpa;
        self.gap_mm = state.gap_mm;
        self.contact_force_n = state.contact_force_n;
        self.measured_force_n = state.measured_force_n;
        self.onset_pressure_mpa = state.onset_pressure_mpa;
        self.force_halfwidth_n = state.force_halfwidth_n as f32;
        self.displacement_halfwidth_mm = state.displacement_halfwidth_mm as f32;
        self.von_mises_halfwidth_mpa = state.von_mises_halfwidth_mpa as f32;
        self.regime = state.regime.clone().into();
        self.flags = state.flags.iter().cloned().map(Word::from).collect();
        self.outcome = state.outcome.clone().into();
        self.latency_ms = state.latency_ms();
    }

    /// Takes what the state adds.
    pub fn set_state(&mut self, state: &wire::State) {
        self.pressure_mpa = state.pressure_mpa;
        self.gap_mm = state.gap_mm;
        self.contact_force_n = state.contact_force_n;
        self.measured_force_n = state.measured_force_n;
        self.onset_pressure_mpa = state.onset_pressure_mpa;
        self.force_halfwidth_n = state.force_halfwidth_n;
        self.displacement_halfwidth_mm = state.displacement_halfwidth_mm;
        self.von_mises_halfwidth_mpa = state.von_mises_halfwidth_mpa;
        self.regime = regime::as_str(state.regime).into();
        self.flags = flags::names(state.flags).map(Word::from).collect();
        self.outcome = wire::Outcome::from_code(state.outcome).map_or("", wire::Outcome::as_str).into();
        self.latency_ms = state.t_publish_ns.saturating_sub(state.t_sensor_ns) as f64 * 1e-6;
    }
}

/// Header and numbers as one message. `O(numbers)`.
pub fn encode(header: &impl Serialize, parts: &[&[u32]]) -> Vec<u8> {
    let json = serde_json::to_vec(header).unwrap_or_default(); // plain structs of ours always serialise
    let start = (4 + json.len()).next_multiple_of(4);
    let mut bytes = Vec::with_capacity(start + 4 * parts.iter().map(|part| part.len()).sum::<usize>());
    bytes.extend((json.len() as u32).to_le_bytes());
    bytes.extend(&json);
    bytes.resize(start, 0);
    for part in parts {
        bytes.extend(part.iter().flat_map(|bits| bits.to_le_bytes()));
    }
    bytes
}

/// Floats as the bits that [`encode`] takes.
pub fn bits(values: impl Iterator<Item = f32>) -> Vec<u32> {
    values.map(f32::to_bits).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_start_at_a_multiple_of_four_behind_the_header() {
        for name in ["a", "ab", "abc", "abcd"] {
            let bytes = encode(&FrameHead::empty(name), &[&bits([1.5, -2.0].into_iter())]);
            let length = u32::from_le_bytes(bytes[..4].try_into().expect("four bytes")) as usize;
            let header: serde_json::Value = serde_json::from_slice(&bytes[4..4 + length]).expect("JSON");
            assert_eq!(header["actuator"], name);
            let start = (4 + length).next_multiple_of(4);
            assert_eq!(bytes[start..], [1.5_f32.to_le_bytes(), (-2.0_f32).to_le_bytes()].concat());
        }
    }

    #[test]
    fn unknown_quantities_are_null() {
        let header = serde_json::to_value(FrameHead::empty("finger")).expect("plain data");
        assert!(header["contact_force_n"].is_null() && header["force_halfwidth_n"].is_null());
    }
}
