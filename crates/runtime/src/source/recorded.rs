//! Traces out of recordings: the readings as they were published, to the bit.

use super::reading::Reading;
use super::trace_error::TraceError;
use crate::file;
use recording::message::decode_reading;
use recording::{Item, Reader};
use std::collections::BTreeSet;
use std::io::{BufReader, Read};
use std::path::Path;
use wire::{Payload, SensorSample};

/// Most readings taken from one recording: 11 hours at 1 kHz, 2 GB of memory.
pub const MAX_ROWS: usize = 40_000_000;

/// Whether the file begins as a recording does.
pub(super) fn is_recording(path: &Path) -> std::io::Result<bool> {
    let mut head = Vec::new();
    file::open(path, u64::MAX)?.take(recording::MAGIC.len() as u64).read_to_end(&mut head)?;
    Ok(head == recording::MAGIC)
}

/// The readings of one sensor topic, `topic` or the only one. A recording that stops early gives what it has.
pub(super) fn rows(path: &Path, topic: Option<&str>) -> Result<Vec<Reading>, Vec<TraceError>> {
    let unreadable = |cause: String| vec![TraceError::Unreadable { cause }];
    let file = file::open(path, u64::MAX).map_err(|error| unreadable(error.to_string()))?;
    let mut reader = Reader::new(BufReader::new(file)).map_err(|error| unreadable(error.to_string()))?;
    let (mut rows, mut topics, mut begin_ns) = (Vec::<Reading>::new(), BTreeSet::new(), None);
    while let Some(item) = reader.next_item().map_err(|error| unreadable(error.to_string()))? {
        let Item::Message(message) = item else { continue };
        if message.channel.schema_name != SensorSample::LAYOUT.schema {
            continue;
        }
        if topics.len() < 64 && !topics.contains(&message.channel.topic) {
            topics.insert(message.channel.topic.clone());
        }
        if topic.is_some_and(|topic| topic != message.channel.topic) {
            continue;
        }
        let reading = decode_reading(&message.data).map_err(|error| {
            vec![TraceError::NotAReading { number: rows.len() + 1, cause: error.to_string() }]
        })?;
        if rows.len() >= MAX_ROWS {
            return Err(vec![TraceError::TooManyRows { limit: MAX_ROWS }]);
        }
        let begin_ns = *begin_ns.get_or_insert(reading.t_sensor_ns);
        let row = Reading {
            t_trace_s: reading.t_sensor_ns.wrapping_sub(begin_ns).cast_signed() as f64 * 1e-9,
            pressure_mpa: reading.pressure_mpa,
            gap_mm: reading.gap_mm,
            measured_force_n: reading.measured_force_n,
            status: reading.status,
            markers_mm: reading.markers_mm,
            marker_values: reading.marker_values,
            ..Reading::default()
        };
        if let Some(before) = rows.last().map(|last| last.t_trace_s).filter(|before| row.t_trace_s < *before)
        {
            return Err(vec![TraceError::TimeOrder { line: rows.len() + 1, before, found: row.t_trace_s }]);
        }
        rows.push(row);
    }
    let found = topics.into_iter().collect::<Vec<_>>().join(", ");
    match (topic, rows.is_empty()) {
        (Some(topic), true) => Err(vec![TraceError::NoSuchTopic { topic: topic.into(), found }]),
        (None, _) if found.contains(',') => Err(vec![TraceError::SeveralTopics { found }]),
        (None, true) => Err(vec![TraceError::Empty { what: "readings" }]),
        _ => Ok(rows),
    }
}
