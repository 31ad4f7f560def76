//! A recording in memory: what pictures, series and the viewer take from it.

use crate::failure::configuration;
use anyhow::{Context, Result};
use recording::{Ending, Item, Message, Reader};
use serde::{Deserialize, Deserializer};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use wire::{Topic, TopicKind};

/// Fields that are kept of one recording; with more, every second is let go until they fit.
const MAX_FIELDS: usize = 600;

/// A recording.
pub struct RecordingData {
    /// Its file's name.
    pub name: String,
    /// From the first message to the last, s.
    pub duration_s: f64,
    /// What each actuator did.
    pub tracks: BTreeMap<String, Track>,
}

/// One actuator's part.
#[derive(Default)]
pub struct Track {
    /// States in order of time.
    pub states: Vec<RecordedState>,
    /// Recorded fields in order of time; empty unless asked for.
    pub fields: Vec<RecordedField>,
    stride: usize,
    seen: usize,
}

/// A recorded state. Names as in `softtwin.State`.
#[derive(Clone, Debug, Deserialize)]
#[serde(default)]
pub struct RecordedState {
    /// Seconds after the recording's first message.
    #[serde(skip)]
    pub t_s: f64,
    pub seq: u64,
    pub t_sensor_ns: u64,
    pub t_publish_ns: u64,
    #[serde(deserialize_with = "number")]
    pub pressure_mpa: f64,
    #[serde(deserialize_with = "number")]
    pub gap_mm: f64,
    #[serde(deserialize_with = "number")]
    pub contact_force_n: f64,
    #[serde(deserialize_with = "number")]
    pub measured_force_n: f64,
    #[serde(deserialize_with = "number")]
    pub onset_pressure_mpa: f64,
    #[serde(deserialize_with = "number")]
    pub force_halfwidth_n: f64,
    #[serde(deserialize_with = "number")]
    pub displacement_halfwidth_mm: f64,
    #[serde(deserialize_with = "number")]
    pub von_mises_halfwidth_mpa: f64,
    pub regime: String,
    pub outcome: String,
    pub flags: Vec<String>,
    pub model_hash: String,
}

impl Default for RecordedState {
    fn default() -> Self {
        Self {
            t_s: 0.0,
            seq: 0,
            t_sensor_ns: 0,
            t_publish_ns: 0,
            pressure_mpa: f64::NAN,
            gap_mm: f64::NAN,
            contact_force_n: f64::NAN,
            measured_force_n: f64::NAN,
            onset_pressure_mpa: f64::NAN,
            force_halfwidth_n: f64::NAN,
            displacement_halfwidth_mm: f64::NAN,
            von_mises_halfwidth_mpa: f64::NAN,
            regime: "unknown".into(),
            outcome: String::new(),
            flags: Vec::new(),
            model_hash: String::new(),
        }
    }
}

impl RecordedState {
    /// From sensor stamp to published, ms.
    pub fn latency_ms(&self) -> f64 {
        self.t_publish_ns.saturating_sub(self.t_sensor_ns) as f64 * 1e-6
    }

    /// Whether a model can be asked for this state.
    pub fn has_reading(&self) -> bool {
        self.pressure_mpa.is_finite() && self.pressure_mpa >= 0.0 && !self.gap_mm.is_nan()
    }
}

/// A recorded field.
pub struct RecordedField {
    /// Seconds after the recording's first message.
    pub t_s: f64,
    /// Names of the fields, in order.
    pub fields: Vec<String>,
    /// Nodes a field.
    pub nodes: usize,
    /// Field-major.
    pub values: Vec<f32>,
    /// Pressure, MPa.
    pub pressure_mpa: f64,
    /// Gap, mm.
    pub gap_mm: f64,
}

#[derive(Deserialize)]
struct FieldText {
    fields: Vec<String>,
    node_count: usize,
    values: String,
    #[serde(deserialize_with = "number")]
    pressure_mpa: f64,
    #[serde(deserialize_with = "number")]
    gap_mm: f64,
}

/// Numbers as recordings write them: those that JSON does not know are texts.
fn number<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    Ok(match Value::deserialize(from)? {
        Value::Number(number) => number.as_f64().unwrap_or(f64::NAN),
        Value::String(text) if text == "Infinity" => f64::INFINITY,
        Value::String(text) if text == "-Infinity" => f64::NEG_INFINITY,
        _ => f64::NAN,
    })
}

impl RecordingData {
    /// Reads a recording; of fields at most some hundreds, evenly thinned, and none unless wanted.
    ///
    /// # Errors
    /// A file that is no recording, or one without a state or field in it.
    pub fn read(path: &Path, with_fields: bool) -> Result<Self> {
        let place = || path.display().to_string();
        let file = File::open(path).with_context(place)?;
        let mut reader = Reader::new(BufReader::new(file)).with_context(place).map_err(configuration)?;
        let mut tracks: BTreeMap<String, Track> = BTreeMap::new();
        let (mut first_ns, mut last_ns) = (None, 0);
        while let Some(item) = reader.next_item().with_context(place)? {
            let Item::Message(message) = item else { continue };
            let Some(topic) = Topic::parse(&message.channel.topic) else { continue };
            let start = *first_ns.get_or_insert(message.log_time_ns);
            last_ns = last_ns.max(message.log_time_ns);
            let t_s = message.log_time_ns.saturating_sub(start) as f64 * 1e-9;
            let track = tracks.entry(topic.actuator().to_owned()).or_default();
            match topic.kind() {
                TopicKind::State => track.add_state(&message, t_s),
                TopicKind::Field if with_fields => track.add_field(&message, t_s),
                _ => {}
            }
        }
        tracks.retain(|_, track| !(track.states.is_empty() && track.fields.is_empty()));
        if tracks.is_empty() {
            let expected = "expected a recording with states (softtwin/NAME/state), found none";
            return Err(configuration(anyhow::anyhow!("{}: {expected}", place())));
        }
        if let Some(ending) = reader.ending().filter(|ending| **ending != Ending::Complete) {
            tracing::warn!("{} is not whole, what can be read is used: {ending:?}", place());
        }
        Ok(Self {
            name: path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            duration_s: last_ns.saturating_sub(first_ns.unwrap_or(last_ns)) as f64 * 1e-9,
            tracks,
        })
    }
}

impl Track {
    fn add_state(&mut self, message: &Message, t_s: f64) {
        if let Ok(state) = serde_json::from_slice::<RecordedState>(&message.data) {
            self.states.push(RecordedState { t_s, ..state });
        }
    }

    fn add_field(&mut self, message: &Message, t_s: f64) {
        self.seen += 1;
        if !(self.seen - 1).is_multiple_of(self.stride.max(1)) {
            return;
        }
        let Ok(text) = serde_json::from_slice::<FieldText>(&message.data) else { return };
        let Some(values) = recording::message::field_values(&text.values) else { return };
        if values.len() != text.node_count.saturating_mul(text.fields.len()) {
            return;
        }
        let FieldText { fields, node_count: nodes, pressure_mpa, gap_mm, .. } = text;
        self.fields.push(RecordedField { t_s, fields, nodes, values, pressure_mpa, gap_mm });
        if self.fields.len() > MAX_FIELDS {
            let mut keep = false;
            self.fields.retain(|_| {
                keep = !keep;
                keep
            });
            self.stride = 2 * self.stride.max(1);
        }
    }

    /// The newest state at a time; the first one before it.
    pub fn state_at(&self, t_s: f64) -> Option<&RecordedState> {
        let after = self.states.partition_point(|state| state.t_s <= t_s);
        self.states.get(after.saturating_sub(1))
    }

    /// The newest field at a time; the first one before it.
    pub fn field_at(&self, t_s: f64) -> Option<&RecordedField> {
        let after = self.fields.partition_point(|field| field.t_s <= t_s);
        self.fields.get(after.saturating_sub(1))
    }

    /// Every n-th state, so that at most about `most` remain.
    pub fn thinned(&self, most: usize) -> impl Iterator<Item = &RecordedState> {
        self.states.iter().step_by(self.states.len().div_ceil(most.max(1)).max(1))
    }
}
