//! A recording in memory: what pictures, series and the viewer take from it.

use crate::message::{decode, decode_field};
use crate::{Item, Message, ReadError, ReadItems, RecordingFiles, RunClock, SeriesReader, Stamps};
use rom::inputs::{InputSpec, Inputs};
use std::collections::BTreeMap;
use std::ops::Deref;
use std::sync::atomic::{AtomicBool, Ordering};
use wire::layout::pack_slot;
use wire::{FieldHeader, KeyExpr, State, Topic, TopicKind};

/// Fields that are kept of one actuator; of more, every second one is dropped until they fit.
const MAX_FIELDS: usize = 600;
/// States that pictures and the viewer keep of one actuator: 100 MB.
const MAX_STATES: usize = 130_000;

pub struct RecordingData {
    /// Display name.
    pub name: String,
    /// From the first message to the last, s.
    pub duration_s: f64,
    /// Data of each actuator.
    pub tracks: BTreeMap<String, Track>,
    /// What was left out, and what is damaged.
    pub remarks: Vec<String>,
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
    /// A list of at most `max` entries.
    pub fn new(max: usize) -> Self {
        Self { entries: Vec::new(), max, stride: 1, offered: 0 }
    }

    /// Adds what `make` returns, unless it falls between two entries that are kept.
    pub fn offer(&mut self, make: impl FnOnce() -> Option<T>) {
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

#[derive(Clone, Debug)]
pub struct RecordedState {
    /// Seconds after the recording's first message.
    pub t_s: f64,
    /// Published value.
    pub values: State,
}

impl RecordedState {
    /// From sensor stamp to published, ms.
    pub fn latency_ms(&self) -> f64 {
        self.values.t_publish_ns.saturating_sub(self.values.t_sensor_ns) as f64 * 1e-6
    }

    /// The inputs at which a model with these inputs can be evaluated for this state; none when it stands for no reading.
    pub fn inputs(&self, specs: &[InputSpec]) -> Option<Inputs> {
        let State { pressure_mpa, gap_mm, input_count, .. } = self.values;
        let mut inputs = Inputs::new(pressure_mpa, gap_mm);
        let mut is_reading = input_count > 0 || pressure_mpa.is_finite() && !gap_mm.is_nan();
        let places: Vec<[u8; 32]> = specs.iter().map(|input| pack_slot(&input.key())).collect();
        for input in self.values.inputs() {
            let at = places.iter().position(|name| *name == pack_slot(&input.name))?;
            inputs = inputs.with(at, input.value);
            is_reading &= !input.value.is_nan();
        }
        let is_below_0 = inputs.pressure_mpa() < 0.0;
        (is_reading && !is_below_0).then_some(inputs)
    }
}

/// A field of a recording.
pub struct RecordedField {
    /// Seconds after the recording's first message.
    pub t_s: f64,
    /// Published value.
    pub header: FieldHeader,
    /// Field-major.
    pub values: Vec<f32>,
}

impl RecordedState {
    /// From its message; none when it is no state.
    pub fn read(data: &[u8], t_s: f64) -> Option<Self> {
        Some(Self { t_s, values: decode(data).ok()? })
    }
}

impl RecordedField {
    /// From its message; none when it is no field.
    pub fn read(data: &[u8], t_s: f64) -> Option<Self> {
        let (header, values) = decode_field(data).ok()?;
        Some(Self { t_s, header, values })
    }
}

/// The messages of a recording, of one file or of many, with their time.
pub struct Messages {
    reader: SeriesReader,
    place: String,
    clock: RunClock,
    first_ns: Option<i128>,
    last_ns: i128,
}

impl Messages {
    /// At the first message.
    pub fn open(series: &RecordingFiles) -> Self {
        let place = series.files.first().map(|path| path.display().to_string()).unwrap_or_default();
        let clock = RunClock::new(Stamps::Wall);
        Self { reader: series.reader(), place, clock, first_ns: None, last_ns: i128::MIN }
    }

    /// The next message on a topic of ours, with its time after the recording's first one, s.
    ///
    /// # Errors
    /// A file that is no recording.
    pub fn next_message(&mut self) -> Result<Option<(Topic, f64, Message)>, ReadError> {
        while let Some(item) = self.reader.next_item()? {
            self.clock.take(&item);
            let Item::Message(message) = item else { continue };
            let Some(topic) = Topic::parse(&message.channel.topic) else { continue };
            let t_ns = self.clock.at(message.log_time_ns);
            let start = *self.first_ns.get_or_insert(t_ns);
            self.last_ns = self.last_ns.max(t_ns);
            let t_s = (t_ns - start).max(0) as f64 * 1e-9;
            return Ok(Some((topic, t_s, message)));
        }
        Ok(None)
    }

    /// From the first message to the last so far, s.
    fn duration_s(&self) -> f64 {
        self.first_ns.map_or(0.0, |first_ns| (self.last_ns - first_ns) as f64 * 1e-9)
    }

    /// At the end: what is not whole.
    pub fn damage(&self) -> Option<String> {
        let is_whole = self.reader.incomplete().is_empty();
        (!is_whole).then(|| {
            format!("{} is not whole, what can be read is used: {}", self.place, self.reader.ending())
        })
    }
}

impl RecordingData {
    /// States of one actuator, in order of time, that come from elsewhere than a file.
    pub fn of_states(name: &str, actuator: &str, states: Vec<RecordedState>) -> Self {
        let duration_s = states.last().map_or(0.0, |state| state.t_s);
        let mut track = Track::new();
        states.into_iter().for_each(|state| track.add_state(state));
        let tracks = BTreeMap::from([(actuator.to_owned(), track)]);
        Self { name: name.into(), duration_s, tracks, remarks: Vec::new() }
    }

    /// Reads a recording; of each actuator at most [`MAX_STATES`] states, all peaks among them, and of fields at most some
    /// hundreds, those of the topics that `fields` names.
    ///
    /// # Errors
    /// The file is not a recording or has no state or field; `stop` was set before the end (reading a long one takes minutes).
    pub fn read(
        series: &RecordingFiles,
        fields: Option<&KeyExpr>,
        stop: &AtomicBool,
    ) -> Result<Self, ReadError> {
        let mut messages = Messages::open(series);
        let mut tracks: BTreeMap<String, Track> = BTreeMap::new();
        while let Some((topic, t_s, message)) = messages.next_message()? {
            if stop.load(Ordering::Relaxed) {
                return Err(ReadError::Stopped { place: messages.place });
            }
            let track = tracks.entry(topic.actuator().to_owned()).or_insert_with(Track::new);
            match topic.kind() {
                TopicKind::State => {
                    if let Some(state) = RecordedState::read(&message.data, t_s) {
                        track.add_state(state);
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
            return Err(ReadError::NoStates { place: messages.place });
        }
        let thinned = tracks.iter().filter(|(_, track)| track.states.len() < track.recorded);
        let mut remarks: Vec<String> = thinned
            .map(|(actuator, track)| {
                let (used, recorded) = (track.states.len(), track.recorded);
                format!("{actuator}: {used} of {recorded} recorded states are used, all peaks among them")
            })
            .collect();
        remarks.extend(messages.damage());
        // The wall clock may have been set back between two runs of the recorder.
        tracks.values_mut().for_each(|track| track.states.sort_by(|a, b| a.t_s.total_cmp(&b.t_s)));
        Ok(Self { name: series.name.clone(), duration_s: messages.duration_s(), tracks, remarks })
    }
}

impl Track {
    fn new() -> Self {
        Self { states: Vec::new(), recorded: 0, fields: Thinned::new(MAX_FIELDS) }
    }

    fn add_state(&mut self, state: RecordedState) {
        self.recorded += 1;
        self.states.push(state);
        if self.states.len() > MAX_STATES {
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
#[path = "../tests/unit/tracks.rs"]
mod tests;
