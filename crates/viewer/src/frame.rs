//! Frames for the browser: a JSON header, then numbers.
//!
//! Layout of a binary message: `u32` length of the header, the header as JSON, zeros up to a multiple of four, then
//! little-endian 32-bit numbers.

use recording::message::Json;
use serde::{Serialize, Serializer};
use wire::layout::{field_id, pack_name};
use wire::{FieldHeader, Payload, State};

/// Header of one frame of one actuator; the numbers behind it are `fields x count`, field-major `f32`.
///
/// The values of [`State`] are in the same object: the browser reads `softtwin.State` with these additions. A field without
/// its state fills the values that both have.
#[derive(Clone, Debug, Serialize)]
pub struct FrameHead {
    kind: &'static str,
    /// Number of the model whose mesh belongs to the nodes; none: nodes without a known surface.
    pub model: Option<usize>,
    /// True for an answer to "what if".
    pub predicted: bool,
    /// Names of the fields behind the header.
    pub fields: Vec<&'static str>,
    /// Nodes per field.
    pub count: usize,
    /// Largest von Mises stress, MPa.
    pub max_von_mises_mpa: f64,
    /// The model's node with that stress.
    pub max_von_mises_node: Option<u32>,
    /// From sensor stamp to published, ms; null: there is no reading.
    latency_ms: Option<f64>,
    /// Readings a second.
    pub rate_hz: f64,
    /// Time of the recording, s; null: live.
    pub t_s: f64,
    /// Whether a recording is running.
    pub playing: bool,
    #[serde(flatten, serialize_with = "state_json")]
    state: State,
}

impl FrameHead {
    /// A header in which nothing is known.
    pub fn empty(actuator: &str) -> Self {
        Self {
            kind: "frame",
            model: None,
            predicted: false,
            fields: Vec::new(),
            count: 0,
            max_von_mises_mpa: f64::NAN,
            max_von_mises_node: None,
            latency_ms: None,
            rate_hz: f64::NAN,
            t_s: f64::NAN,
            playing: false,
            state: State { flags: 0, actuator: pack_name(actuator), ..State::default() },
        }
    }

    /// Copies the values of a field's header.
    pub fn set_field(&mut self, header: &FieldHeader) {
        self.max_von_mises_mpa = header.max_von_mises_mpa;
        self.max_von_mises_node = Some(header.max_von_mises_node).filter(|node| *node != u32::MAX);
        self.fields = header.fields().map(field_id::as_str).collect();
        self.set_state(&State {
            seq: header.seq,
            t_sensor_ns: header.t_sensor_ns,
            t_publish_ns: header.t_publish_ns,
            pressure_mpa: header.pressure_mpa,
            gap_mm: header.gap_mm,
            contact_force_n: header.contact_force_n,
            regime: header.regime,
            flags: header.flags,
            inputs: header.inputs,
            input_count: header.input_count,
            input_names: header.input_names,
            input_sources: header.input_sources,
            ..self.state
        });
    }

    /// Copies a state; the actuator stays.
    pub fn set_state(&mut self, state: &State) {
        self.state = State { actuator: self.state.actuator, ..*state };
        let latency_ns = state.t_publish_ns.saturating_sub(state.t_sensor_ns);
        self.latency_ms = (state.t_sensor_ns > 0).then_some(latency_ns as f64 * 1e-6);
    }
}

fn state_json<S: Serializer>(state: &State, to: S) -> Result<S::Ok, S::Error> {
    Json::new(state.view()).serialize(to)
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
#[path = "../tests/unit/frame.rs"]
mod tests;
