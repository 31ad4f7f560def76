//! A recording in memory: what pictures, series and the viewer take from it.

use crate::failure::configuration;
use anyhow::{Context, Result};
use recording::message::{decode, decode_field};
use recording::{Ending, Item, Reader};
use rom::inputs::Inputs;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::ops::Deref;
use std::path::Path;
use wire::{FieldHeader, State, Topic, TopicKind};

/// Fields that are kept of one actuator; of more, every second one is dropped until they fit.
const MAX_FIELDS: usize = 600;
/// States that pictures and the viewer keep of one actuator: 230 MB.
pub const MAX_STATES: usize = 300_000;

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
pub struct Track {
    /// States in order of time.
    pub states: Thinned<RecordedState>,
    /// Recorded fields in order of time; empty unless asked for.
    pub fields: Thinned<RecordedField>,
}

/// A list of bounded length: when it is full, every second entry is dropped, and then only every second one comes in.
pub struct Thinned<T> {
    entries: Vec<T>,
    max: usize,
    stride: usize,
    offered: usize,
}

impl<T> Thinned<T> {
    fn new(max: usize) -> Self {
        Self { entries: Vec::new(), max, stride: 1, offered: 0 }
    }

    /// Adds what `make` returns, unless it falls between two entries that are kept.
    fn offer(&mut self, make: impl FnOnce() -> Option<T>) {
        self.offered += 1;
        if !(self.offered - 1).is_multiple_of(self.stride) {
            return;
        }
        self.entries.extend(make());
        if self.entries.len() > self.max {
            let mut keep = false;
            self.entries.retain(|_| {
                keep = !keep;
                keep
            });
            self.stride *= 2;
        }
    }
}

impl<T> Deref for Thinned<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.entries
    }
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

impl RecordedState {
    fn read(data: &[u8], t_s: f64) -> Option<Self> {
        Some(Self { t_s, values: decode(data).ok()? })
    }
}

impl RecordedField {
    fn read(data: &[u8], t_s: f64) -> Option<Self> {
        let (header, values) = decode_field(data).ok()?;
        Some(Self { t_s, header, values })
    }
}

impl RecordingData {
    /// Reads a recording; of each actuator at most `max_states` states, evenly thinned, and of fields at most some hundreds,
    /// none unless wanted.
    ///
    /// # Errors
    /// A file that is no recording, or one without a state or field in it.
    pub fn read(path: &Path, with_fields: bool, max_states: usize) -> Result<Self> {
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
            let track = tracks.entry(topic.actuator().to_owned()).or_insert_with(|| Track::new(max_states));
            match topic.kind() {
                TopicKind::State => track.states.offer(|| RecordedState::read(&message.data, t_s)),
                TopicKind::Field if with_fields => {
                    track.fields.offer(|| RecordedField::read(&message.data, t_s));
                }
                _ => {}
            }
        }
        tracks.retain(|_, track| !(track.states.is_empty() && track.fields.is_empty()));
        if tracks.is_empty() {
            let expected = "expected a recording with states (softtwin/NAME/state), found none";
            return Err(configuration(anyhow::anyhow!("{}: {expected}", place())));
        }
        for (actuator, track) in tracks.iter().filter(|(_, track)| track.states.stride > 1) {
            let Thinned { offered, stride, .. } = track.states;
            tracing::warn!("{actuator}: of {offered} recorded states one in {stride} is used");
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
    fn new(max_states: usize) -> Self {
        Self { states: Thinned::new(max_states), fields: Thinned::new(MAX_FIELDS) }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thinned_list_is_bounded_and_stays_even() {
        let mut list = Thinned::new(100);
        (0..100_000).for_each(|k| list.offer(|| Some(k)));
        assert!(list.len() <= 100 && list.len() > 40, "{}", list.len());
        let step = list[1] - list[0];
        assert!(list[0] == 0 && list.windows(2).all(|pair| pair[1] - pair[0] == step), "{:?}", &list[..]);
    }
}
