//! Traces from recordings: readings bit-identical to the published ones. A recording is a file or a folder of rotated files.

use formats::{Diagnostic, file};
use recording::message::decode_reading;
use recording::{Item, Message, ReadItems, RecordingFiles, RunClock, SeriesReader, Stamps};
use std::collections::BTreeSet;
use std::io::Read;
use std::path::Path;
use wire::{Payload, SensorSample};

/// Most readings taken into memory from one recording: 11 hours at 1 kHz. A replay takes them one by one and has no limit.
pub const MAX_ROWS: usize = 40_000_000;
/// Largest time of a stamp after that of its recording, ns: the default of `max_ahead_ms`.
const AHEAD_NS: i128 = 100_000_000;

/// Whether the path is a recording: a file that begins as one does, or no file.
pub(super) fn is_recording(path: &Path) -> Result<bool, TraceError> {
    if path.is_dir() || (!path.exists() && RecordingFiles::open(path).is_ok()) {
        return Ok(true);
    }
    let mut head = Vec::new();
    let (file, _) = file::open(path, u64::MAX).map_err(|error| TraceError::unreadable(error.cause()))?;
    let read = file.take(recording::MAGIC.len() as u64).read_to_end(&mut head);
    read.map_err(TraceError::unreadable)?;
    Ok(head == recording::MAGIC)
}

/// The readings of one sensor topic, `topic` or the only one. A recording that stops early gives what it has.
pub(super) fn rows(path: &Path, topic: Option<&str>) -> Result<Vec<SensorSample>, Vec<TraceError>> {
    let mut rows = Rows::open(path, topic).map_err(|error| vec![error])?;
    let mut all = Vec::new();
    while let Some(row) = rows.next_row().map_err(|error| vec![error])? {
        if all.len() >= MAX_ROWS {
            return Err(vec![TraceError::TooManyRows { limit: MAX_ROWS }]);
        }
        all.push(row);
    }
    rows.check_topics().map_err(|error| vec![error])?;
    rows.left_out().warn(path);
    Ok(all)
}

/// Readings of a recording, one after the other. Memory: one chunk of the recording.
#[derive(Debug)]
pub(super) struct Rows {
    reader: SeriesReader,
    topic: Option<String>,
    topics: BTreeSet<String>,
    clock: RunClock,
    begin_ns: Option<i128>,
    last_s: f64,
    number: usize,
    left_out: LeftOut,
}

/// Readings of a recording that are not played.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct LeftOut {
    /// Stamped before the one before them: the twin dropped them, too.
    pub late: usize,
    /// Stamped after the time of their recording: the twin held them, too.
    pub ahead: usize,
    /// Messages that are no reading.
    pub unreadable: usize,
    /// Cause of the first of these.
    pub cause: String,
}

impl Rows {
    pub(super) fn open(path: &Path, topic: Option<&str>) -> Result<Self, TraceError> {
        let series = RecordingFiles::open(path).map_err(TraceError::unreadable)?;
        Ok(Self {
            reader: series.reader(),
            topic: topic.map(str::to_owned),
            topics: BTreeSet::new(),
            clock: RunClock::new(Stamps::Monotonic),
            begin_ns: None,
            last_s: f64::NEG_INFINITY,
            number: 0,
            left_out: LeftOut::default(),
        })
    }

    /// Readings left out so far.
    pub(super) fn left_out(&self) -> &LeftOut {
        &self.left_out
    }

    /// The next reading of the topic, in order of time.
    pub(super) fn next_row(&mut self) -> Result<Option<SensorSample>, TraceError> {
        while let Some(item) = self.next_item()? {
            self.clock.take(&item);
            let Item::Message(message) = item else { continue };
            if message.channel.schema_name != SensorSample::LAYOUT.schema {
                continue;
            }
            if self.topics.len() < 64 && !self.topics.contains(&message.channel.topic) {
                self.topics.insert(message.channel.topic.clone());
            }
            if self.topic.as_ref().is_none_or(|topic| *topic == message.channel.topic)
                && let Some(row) = self.row(&message)
            {
                return Ok(Some(row));
            }
        }
        Ok(None)
    }

    fn next_item(&mut self) -> Result<Option<Item>, TraceError> {
        self.reader.next_item().map_err(TraceError::unreadable)
    }

    fn row(&mut self, message: &Message) -> Option<SensorSample> {
        let reading = match decode_reading(&message.data) {
            Ok(reading) => reading,
            Err(error) => {
                if self.left_out.unreadable == 0 {
                    self.left_out.cause = error.to_string();
                }
                self.left_out.unreadable += 1;
                return None;
            }
        };
        let recorded_ns = self.clock.recorded_at(message.log_time_ns);
        if recorded_ns.is_some_and(|at_ns| i128::from(reading.t_sensor_ns) > at_ns + AHEAD_NS) {
            self.left_out.ahead += 1; // it must not make all later readings late
            return None;
        }
        let t_ns = self.clock.at(reading.t_sensor_ns);
        let begin_ns = *self.begin_ns.get_or_insert(t_ns);
        let t_trace_s = (t_ns - begin_ns) as f64 * 1e-9;
        if t_trace_s < self.last_s {
            self.left_out.late += 1;
            return None;
        }
        self.number += 1;
        self.last_s = t_trace_s;
        Some(SensorSample { t_trace_s, boot_id: 0, seq: 0, t_sensor_ns: 0, ..reading })
    }

    /// At the end: whether it was clear which topic is meant, and there was one.
    pub(super) fn check_topics(&self) -> Result<(), TraceError> {
        let found = self.topics.iter().cloned().collect::<Vec<_>>().join(", ");
        if self.number == 0 && self.left_out.unreadable > 0 {
            return Err(TraceError::NotAReading { number: 1, cause: self.left_out.cause.clone() });
        }
        match (&self.topic, self.number == 0) {
            (Some(topic), true) => Err(TraceError::NoSuchTopic { topic: topic.clone(), found }),
            (None, _) if found.contains(',') => Err(TraceError::SeveralTopics { found }),
            (None, true) => Err(TraceError::Empty),
            _ => Ok(()),
        }
    }
}

impl LeftOut {
    /// Logs what is left out.
    pub(super) fn warn(&self, path: &Path) {
        let Self { late, ahead, unreadable, cause } = self;
        let (late, ahead, unreadable, path) = (*late, *ahead, *unreadable, path.display());
        if late > 0 {
            tracing::warn!(
                "{late} readings are stamped before the one before them and left out, as by the twin ({path})"
            );
        }
        if ahead > 0 {
            tracing::warn!(
                "{ahead} readings are stamped in their future and left out, as by the twin ({path})"
            );
        }
        if unreadable > 0 {
            tracing::warn!("{unreadable} messages are no readings and left out, the first: {cause} ({path})");
        }
    }
}

#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TraceError {
    /// The file could not be read.
    #[error("cannot read the trace: {cause}")]
    Unreadable { cause: String },
    #[error(
        "the trace has no row; expected the header `t_s,pressure_mpa,gap_mm` and at least one row, or a recording with readings"
    )]
    Empty,
    /// The table: a column, a cell, or the order of time.
    #[error("{0}")]
    Table(Diagnostic),
    /// A message of a recording that is no reading.
    #[error("reading {number} of the recording cannot be read: {cause}")]
    NotAReading { number: usize, cause: String },
    /// A recording of several actuators.
    #[error("the recording has several sensors ({found}); choose one with `topic`")]
    SeveralTopics { found: String },
    /// The topic that was asked for is not there.
    #[error("the recording has no readings on `{topic}`; found: {found}")]
    NoSuchTopic { topic: String, found: String },
    /// More than fits into memory.
    #[error(
        "the recording has more than {limit} readings; record with --rotate-minutes and replay the part you need"
    )]
    TooManyRows { limit: usize },
}

impl TraceError {
    pub(super) fn unreadable(cause: impl ToString) -> Self {
        Self::Unreadable { cause: cause.to_string() }
    }
}
