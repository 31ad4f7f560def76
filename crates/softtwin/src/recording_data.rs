//! A recording in memory: what pictures, series and the viewer take from it.

use crate::failure::configuration;
use anyhow::{Context, Result};
use recording::message::{decode, field_values};
use recording::{Ending, Item, Message, Reader};
use rom::inputs::Inputs;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use wire::{FieldHeader, State, Topic, TopicKind};

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

/// A recorded state.
#[derive(Clone, Debug)]
pub struct RecordedState {
    /// Seconds after the recording's first message.
    pub t_s: f64,
    /// As it was published.
    pub values: State,
}

impl RecordedState {
    /// From sensor stamp to published, ms.
    pub fn latency_ms(&self) -> f64 {
        self.values.t_publish_ns.saturating_sub(self.values.t_sensor_ns) as f64 * 1e-6
    }

    /// The inputs at which a model can be evaluated for this state; none when it stands for no reading.
    pub fn inputs(&self) -> Option<Inputs> {
        let State { pressure_mpa, gap_mm, .. } = self.values;
        let is_reading = pressure_mpa.is_finite() && pressure_mpa >= 0.0 && !gap_mm.is_nan();
        is_reading.then(|| Inputs::new(pressure_mpa, gap_mm))
    }
}

/// A recorded field.
pub struct RecordedField {
    /// Seconds after the recording's first message.
    pub t_s: f64,
    /// As it was published.
    pub header: FieldHeader,
    /// Field-major.
    pub values: Vec<f32>,
}

#[derive(Deserialize)]
struct FieldText {
    values: String,
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
        if let Ok(values) = decode(&message.data) {
            self.states.push(RecordedState { t_s, values });
        }
    }

    fn add_field(&mut self, message: &Message, t_s: f64) {
        self.seen += 1;
        if !(self.seen - 1).is_multiple_of(self.stride.max(1)) {
            return;
        }
        let header = decode::<FieldHeader>(&message.data).ok();
        let text = serde_json::from_slice::<FieldText>(&message.data).ok();
        let values = text.and_then(|text| field_values(&text.values));
        let (Some(header), Some(values)) = (header, values) else { return };
        if values.len() as u64 != header.entries() {
            return;
        }
        self.fields.push(RecordedField { t_s, header, values });
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
