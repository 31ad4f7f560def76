//! A recording in memory: what pictures, series and the viewer take from it.

use crate::failure::configuration;
use anyhow::{Context, Result};
use recording::message::{decode, decode_field};
use recording::{Ending, Item, Reader};
use rom::inputs::Inputs;
use std::collections::BTreeMap;
use std::io::BufReader;
use std::ops::Deref;
use std::path::Path;
use wire::{FieldHeader, KeyExpr, State, Topic, TopicKind};

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
    pub states: Vec<RecordedState>,
    /// How many states the recording has.
    recorded: usize,
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
    /// Reads a recording; of each actuator at most `max_states` states, all peaks among them, and of fields at most some
    /// hundreds, those of the topics that `fields` names.
    ///
    /// # Errors
    /// A file that is no recording, or one without a state or field in it.
    pub fn read(path: &Path, fields: Option<&KeyExpr>, max_states: usize) -> Result<Self> {
        let place = || path.display().to_string();
        let file = runtime::file::open(path, u64::MAX).with_context(place)?;
        let mut reader = Reader::new(BufReader::new(file)).with_context(place).map_err(configuration)?;
        let mut tracks: BTreeMap<String, Track> = BTreeMap::new();
        let (mut first_ns, mut last_ns) = (None, 0);
        while let Some(item) = reader.next_item().with_context(place)? {
            let Item::Message(message) = item else { continue };
            let Some(topic) = Topic::parse(&message.channel.topic) else { continue };
            let start = *first_ns.get_or_insert(message.log_time_ns);
            last_ns = last_ns.max(message.log_time_ns);
            let t_s = message.log_time_ns.saturating_sub(start) as f64 * 1e-9;
            let track = tracks.entry(topic.actuator().to_owned()).or_insert_with(Track::new);
            match topic.kind() {
                TopicKind::State => {
                    if let Some(state) = RecordedState::read(&message.data, t_s) {
                        track.add_state(state, max_states);
                    }
                }
                TopicKind::Field if fields.is_some_and(|wanted| wanted.matches(&message.channel.topic)) => {
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
        for (actuator, track) in tracks.iter().filter(|(_, track)| track.states.len() < track.recorded) {
            let (used, recorded) = (track.states.len(), track.recorded);
            tracing::warn!("{actuator}: {used} of {recorded} recorded states are used, all peaks among them");
        }
        if let Some(ending) = reader.ending().filter(|ending| **ending != Ending::Complete) {
            tracing::warn!("{} is not whole, what can be read is used: {ending}", place());
        }
        Ok(Self {
            name: path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            duration_s: last_ns.saturating_sub(first_ns.unwrap_or(last_ns)) as f64 * 1e-9,
            tracks,
        })
    }
}

impl Track {
    fn new() -> Self {
        Self { states: Vec::new(), recorded: 0, fields: Thinned::new(MAX_FIELDS) }
    }

    fn add_state(&mut self, state: RecordedState, max_states: usize) {
        self.recorded += 1;
        self.states.push(state);
        if self.states.len() > max_states {
            keep_peaks(&mut self.states);
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

/// Quantities whose peaks stay.
const QUANTITIES: [fn(&RecordedState) -> f64; 4] = [
    |state| state.values.pressure_mpa,
    |state| state.values.gap_mm,
    |state| state.values.contact_force_n,
    RecordedState::latency_ms,
];
/// States of a group, of which at most nine stay.
const GROUP: usize = 36;

/// Keeps of each group the first state and those with the smallest and the largest value of each quantity.
fn keep_peaks(states: &mut Vec<RecordedState>) {
    let mut kept = Vec::with_capacity(states.len() / 4 + GROUP);
    for group in states.chunks(GROUP) {
        let mut is_kept = [false; GROUP];
        is_kept[0] = true;
        for quantity in QUANTITIES {
            let finite = || (0..group.len()).filter(|k| quantity(&group[*k]).is_finite());
            let order = |a: &usize, b: &usize| quantity(&group[*a]).total_cmp(&quantity(&group[*b]));
            for k in finite().min_by(order).into_iter().chain(finite().max_by(order)) {
                is_kept[k] = true;
            }
        }
        kept.extend(
            group.iter().zip(is_kept).filter(|(_, is_kept)| *is_kept).map(|(state, _)| state.clone()),
        );
    }
    *states = kept;
}

#[cfg(test)]
#[path = "../tests/unit/recording_data.rs"]
mod tests;
