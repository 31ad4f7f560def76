//! Headers of the frames of running twins and recordings ([`page::frame`] has those of predictions).

use page::Shape;
use recording::message::Json;
use serde::{Serialize, Serializer};
use wire::layout::{field_id, pack_name};
use wire::{FieldHeader, Payload, State};

/// Header of one frame of one actuator, live or recorded.
///
/// The values of [`State`] are in the same object: the browser reads `softtwin.State` with these additions. A field without
/// its state fills the values that both have.
#[derive(Clone, Debug, Serialize)]
pub struct FrameHead {
    kind: &'static str,
    /// The values behind the header.
    #[serde(flatten)]
    pub shape: Shape,
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
            shape: Shape::EMPTY,
            latency_ms: None,
            rate_hz: f64::NAN,
            t_s: f64::NAN,
            playing: false,
            state: State { flags: 0, actuator: pack_name(actuator), ..State::default() },
        }
    }

    /// Copies the values of a field's header.
    pub fn set_field(&mut self, header: &FieldHeader) {
        self.shape.max_von_mises_mpa = header.max_von_mises_mpa;
        self.shape.max_von_mises_node = Some(header.max_von_mises_node).filter(|node| *node != u32::MAX);
        self.shape.fields = header.fields().map(field_id::as_str).collect();
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

#[cfg(test)]
#[path = "../tests/unit/frame.rs"]
mod tests;
