//! Fields: the newest one, at a fixed rate or on demand, read only while somebody wants it.

use crate::lane::{Lane, Parcel, forget_wake_ups};
use crate::link::Link;
use recording::message::{FieldMessage, Recorded};
use std::sync::mpsc::Receiver;
use std::thread;
use std::time::{Duration, Instant};
use wire::{Bus, FieldReader, FieldSample, WireError};
use zenoh::bytes::ZBytes;

/// Longest sleep: how late it is seen that somebody wants a field.
const TICK: Duration = Duration::from_millis(50);

/// Moves fields until the gateway ends, of each topic one every `period`; `news` brings lanes.
///
/// # Errors
/// When the domain cannot be joined.
pub fn run(link: &Link, news: &Receiver<Lane>, period: Duration) -> anyhow::Result<()> {
    let bus = Bus::open(&link.domain)?;
    let mut flows: Vec<Flow> = Vec::new();
    while !link.is_stopped() {
        flows.extend(news.try_iter().map(Flow::new));
        let now = Instant::now();
        for flow in &mut flows {
            flow.turn(link, &bus, now, period);
        }
        let next = flows.iter().filter_map(Flow::due).min().unwrap_or(now + TICK).min(now + TICK);
        thread::sleep(next.saturating_duration_since(Instant::now()));
    }
    Ok(())
}

/// One topic on its way.
struct Flow {
    lane: Lane,
    reader: Option<FieldReader>,
    newest: Option<Parcel>,
    due: Instant,
    is_refused: bool,
}

impl Flow {
    fn new(lane: Lane) -> Self {
        Self { lane, reader: None, newest: None, due: Instant::now(), is_refused: false }
    }

    /// When the next field is to be sent, while somebody wants one.
    fn due(&self) -> Option<Instant> {
        self.reader.as_ref().map(|_| self.due)
    }

    fn turn(&mut self, link: &Link, bus: &Bus, now: Instant, period: Duration) {
        self.lane.give_up(link, now);
        match (self.lane.is_wanted(now), self.reader.is_some()) {
            (true, false) => self.open(bus),
            (false, true) => (self.reader, self.newest) = (None, None),
            _ => {}
        }
        if let Err(error) = self.pump(link, now, period) {
            tracing::warn!("{error}; the topic is opened again");
            self.reader = None;
        }
    }

    fn open(&mut self, bus: &Bus) {
        match FieldReader::attach(bus, &self.lane.topic) {
            Ok(reader) => (self.reader, self.is_refused) = (Some(reader), false),
            Err(error) if !self.is_refused => {
                tracing::warn!("{error}; it is tried again");
                self.is_refused = true;
            }
            Err(_) => {}
        }
    }

    fn pump(&mut self, link: &Link, now: Instant, period: Duration) -> Result<(), WireError> {
        let Some(reader) = &self.reader else { return Ok(()) };
        forget_wake_ups(reader)?;
        let is_due = now >= self.due;
        if is_due {
            // In step, unless a whole period was missed.
            self.due = if now < self.due + period { self.due + period } else { now + period };
        }
        if (is_due || self.lane.is_asked())
            && let Some(sample) = reader.newest()?
        {
            let parcel = parcel(&sample);
            drop(sample); // before the network takes its time
            if is_due && self.lane.is_heard() {
                self.lane.send(&parcel, &link.counters.fields);
            }
            self.newest = Some(parcel);
        }
        if let (true, Some(newest)) = (self.lane.is_asked(), &self.newest) {
            self.lane.answer(link, newest);
        }
        Ok(())
    }
}

/// The values as they lie in memory, the header as JSON beside them.
fn parcel(sample: &FieldSample) -> Parcel {
    let mut header = Vec::with_capacity(768);
    FieldMessage::new(sample.header(), &[]).encode(&mut header);
    Parcel { payload: values(sample.values()), attachment: Some(ZBytes::from(header)) }
}

/// Values as little-endian bytes. `O(values)`, one copy.
pub fn values(values: &[f32]) -> ZBytes {
    let mut bytes = Vec::with_capacity(size_of_val(values));
    for value in values {
        bytes.extend_from_slice(&value.to_le_bytes());
    }
    ZBytes::from(bytes)
}
