//! Traces from recordings: readings bit-identical to the published ones. A recording is a file or a folder of rotated files.

use crate::file;
use recording::message::decode_reading;
use recording::{Item, ReadItems, Series, SeriesReader};
use std::collections::BTreeSet;
use std::io::Read;
use std::path::Path;
use wire::{Payload, SensorSample};

/// Most readings taken into memory from one recording: 11 hours at 1 kHz. A replay takes them one by one and has no limit.
pub const MAX_ROWS: usize = 40_000_000;
/// Metadata of every file: offset from its stamps to the time since 1970, because stamps restart with the machine.
const OF_RUN: (&str, &str) = ("softtwin.recording", "wall_minus_monotonic_ns");

/// Whether the path is a recording: a file that begins as one does, or no file.
pub(super) fn is_recording(path: &Path) -> std::io::Result<bool> {
    if path.is_dir() || (!path.exists() && Series::open(path).is_ok()) {
        return Ok(true);
    }
    let mut head = Vec::new();
    file::open(path, u64::MAX)?.take(recording::MAGIC.len() as u64).read_to_end(&mut head)?;
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
    Ok(all)
}

/// Readings of a recording, one after the other. Memory: one chunk of the recording.
#[derive(Debug)]
pub(super) struct Rows {
    reader: SeriesReader,
    topic: Option<String>,
    topics: BTreeSet<String>,
    /// Offset from a stamp to the time since 1970, ns; 0 if the recording has none.
    offset_ns: u64,
    begin_ns: Option<u64>,
    last_s: f64,
    number: usize,
}

impl Rows {
    pub(super) fn open(path: &Path, topic: Option<&str>) -> Result<Self, TraceError> {
        let series =
            Series::open(path).map_err(|error| TraceError::Unreadable { cause: error.to_string() })?;
        Ok(Self {
            reader: series.reader(),
            topic: topic.map(str::to_owned),
            topics: BTreeSet::new(),
            offset_ns: 0,
            begin_ns: None,
            last_s: f64::NEG_INFINITY,
            number: 0,
        })
    }

    /// The next reading of the topic, in order of time.
    pub(super) fn next_row(&mut self) -> Result<Option<SensorSample>, TraceError> {
        while let Some(item) = self.next_item()? {
            let message = match item {
                Item::Message(message) => message,
                Item::Metadata { name, entries } => {
                    let offset = entries.get(OF_RUN.1).filter(|_| name == OF_RUN.0);
                    self.offset_ns = offset.and_then(|text| text.parse().ok()).unwrap_or(self.offset_ns);
                    continue;
                }
            };
            if message.channel.schema_name != SensorSample::LAYOUT.schema {
                continue;
            }
            if self.topics.len() < 64 && !self.topics.contains(&message.channel.topic) {
                self.topics.insert(message.channel.topic.clone());
            }
            if self.topic.as_ref().is_none_or(|topic| *topic == message.channel.topic) {
                return self.row(&message.data).map(Some);
            }
        }
        Ok(None)
    }

    fn next_item(&mut self) -> Result<Option<Item>, TraceError> {
        self.reader.next_item().map_err(|error| TraceError::Unreadable { cause: error.to_string() })
    }

    fn row(&mut self, data: &[u8]) -> Result<SensorSample, TraceError> {
        self.number += 1;
        let reading = decode_reading(data)
            .map_err(|error| TraceError::NotAReading { number: self.number, cause: error.to_string() })?;
        let t_ns = reading.t_sensor_ns.wrapping_add(self.offset_ns);
        let begin_ns = *self.begin_ns.get_or_insert(t_ns);
        let t_trace_s = t_ns.wrapping_sub(begin_ns).cast_signed() as f64 * 1e-9;
        let row = SensorSample { t_trace_s, boot_id: 0, seq: 0, t_sensor_ns: 0, ..reading };
        let (before, found) = (self.last_s, row.t_trace_s);
        if found < before {
            return Err(TraceError::TimeOrder { line: self.number, before, found });
        }
        self.last_s = found;
        Ok(row)
    }

    /// At the end: whether it was clear which topic is meant, and there was one.
    pub(super) fn check_topics(&self) -> Result<(), TraceError> {
        let found = self.topics.iter().cloned().collect::<Vec<_>>().join(", ");
        match (&self.topic, self.number == 0) {
            (Some(topic), true) => Err(TraceError::NoSuchTopic { topic: topic.clone(), found }),
            (None, _) if found.contains(',') => Err(TraceError::SeveralTopics { found }),
            (None, true) => Err(TraceError::Empty { what: "readings" }),
            _ => Ok(()),
        }
    }
}

/// Error in a trace.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TraceError {
    /// The file could not be read.
    #[error("cannot read the trace: {cause}")]
    Unreadable {
        /// The system's message.
        cause: String,
    },
    /// No header or no rows.
    #[error(
        "the trace has no {what}; expected the header `t_s,pressure_mpa,gap_mm` and at least one row, or a recording with readings"
    )]
    Empty {
        /// `header`, `rows` or `readings`.
        what: &'static str,
    },
    /// A required column is missing.
    #[error("line {line}: the column `{column}` is missing; expected `{expected}`, found `{found}`")]
    MissingColumn {
        /// Line of the header.
        line: usize,
        /// The column.
        column: String,
        /// A header that would do.
        expected: String,
        /// The header as found.
        found: String,
    },
    /// A cell is not a number.
    #[error("line {line}, column `{column}`: expected a number, found `{found}`")]
    NotANumber {
        /// Line.
        line: usize,
        /// Column.
        column: String,
        /// The text.
        found: String,
    },
    /// A message of a recording that is no reading.
    #[error("reading {number} of the recording cannot be read: {cause}")]
    NotAReading {
        /// Which reading, from 1.
        number: usize,
        /// Its error.
        cause: String,
    },
    /// A recording of several actuators.
    #[error("the recording has several sensors ({found}); choose one with `topic`")]
    SeveralTopics {
        /// Their topics.
        found: String,
    },
    /// The topic that was asked for is not there.
    #[error("the recording has no readings on `{topic}`; found: {found}")]
    NoSuchTopic {
        /// Asked for.
        topic: String,
        /// Found columns.
        found: String,
    },
    /// More than fits into memory.
    #[error(
        "the recording has more than {limit} readings; record with --rotate-minutes and replay the part you need"
    )]
    TooManyRows {
        /// The limit.
        limit: usize,
    },
    /// Time is not finite or runs backwards.
    #[error("line {line}: time goes from {before} s to {found} s; expected rows in order of time")]
    TimeOrder {
        /// Line.
        line: usize,
        /// Time of the row above.
        before: f64,
        /// Time found.
        found: f64,
    },
}
