//! Fields: the newest one, at a fixed rate or on demand, read only while somebody wants it.

use crate::lane::{Lane, Parcel};
use crate::link::Link;
use recording::GapCounter;
use recording::message::FieldMessage;
use serde::Serialize;
use std::sync::atomic::Ordering;
use std::sync::mpsc::Receiver;
use std::thread;
use std::time::{Duration, Instant};
use wire::{Bus, FieldReader, FieldSample, Waking, WireError};
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
    while link.goes_on() {
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
    /// Fields sent so far: subscribers see by their numbers what the network skipped for them.
    sent: u64,
    /// Follows what is sent: jumps are fields whose place a newer one took.
    gaps: GapCounter,
    is_refused: bool,
}

impl Flow {
    fn new(lane: Lane) -> Self {
        Self {
            lane,
            reader: None,
            newest: None,
            due: Instant::now(),
            sent: 0,
            gaps: GapCounter::default(),
            is_refused: false,
        }
    }

    /// When the next field is to be sent, while somebody wants one.
    fn due(&self) -> Option<Instant> {
        self.reader.as_ref().map(|_| self.due)
    }

    fn turn(&mut self, link: &Link, bus: &Bus, now: Instant, period: Duration) {
        self.lane.give_up(link, now);
        match (self.lane.is_wanted(now), self.reader.is_some()) {
            (true, false) => self.open(bus, now),
            (false, true) => (self.reader, self.newest) = (None, None),
            _ => {}
        }
        if let Err(error) = self.pump(link, now, period) {
            tracing::warn!("{error}; the topic is opened again");
            self.reader = None;
        }
    }

    fn open(&mut self, bus: &Bus, now: Instant) {
        match FieldReader::attach_as(bus, &self.lane.topic, Waking::Never) {
            Ok(reader) => (self.reader, self.due, self.is_refused) = (Some(reader), now, false),
            Err(error) if !self.is_refused => {
                tracing::warn!("{error}; it is tried again");
                self.is_refused = true;
            }
            Err(_) => {}
        }
    }

    fn pump(&mut self, link: &Link, now: Instant, period: Duration) -> Result<(), WireError> {
        let Some(reader) = &self.reader else { return Ok(()) };
        let is_turn = now >= self.due;
        let is_sent = is_turn && self.lane.is_heard();
        if (is_turn || self.lane.is_asked())
            && let Some(sample) = reader.newest()?
        {
            let header = sample.header();
            let (boot_id, seq) = (header.boot_id, header.seq);
            let parcel = parcel(&sample, is_sent.then_some(self.sent + 1));
            drop(sample); // before the network takes its time
            if is_sent {
                self.send(link, &parcel, boot_id, seq);
            }
            self.newest = Some(parcel);
        }
        if is_turn {
            self.next_turn(link, now, period, is_sent);
        }
        if let (true, Some(newest)) = (self.lane.is_asked(), &self.newest) {
            self.lane.answer(link, newest);
        }
        Ok(())
    }

    fn send(&mut self, link: &Link, parcel: &Parcel, boot_id: u64, seq: u64) {
        let counters = &link.counters;
        let replaced = self.gaps.observe(self.lane.topic.name(), boot_id, seq).map_or(0, |gap| gap.missing());
        counters.replaced.fetch_add(replaced, Ordering::Relaxed);
        self.sent += 1;
        self.lane.send(parcel, &counters.fields, &counters.longest_send_us);
    }

    /// In step, unless whole periods were missed. What nobody listens to is neither replaced nor late.
    fn next_turn(&mut self, link: &Link, now: Instant, period: Duration, is_heard: bool) {
        let late = now.saturating_duration_since(self.due).as_nanos() / period.as_nanos().max(1);
        self.due = if late == 0 { self.due + period } else { now + period };
        if is_heard {
            link.counters.late_turns.fetch_add(late as u64, Ordering::Relaxed);
        } else {
            self.gaps.forget(self.lane.topic.name());
        }
    }
}

/// What stands beside the values of a field.
#[derive(Serialize)]
struct About {
    #[serde(flatten)]
    message: FieldMessage,
    #[serde(skip_serializing_if = "Option::is_none")]
    gateway_seq: Option<u64>,
}

/// The values as they lie in memory, the header as JSON beside them.
fn parcel(sample: &FieldSample, gateway_seq: Option<u64>) -> Parcel {
    let about = About { message: FieldMessage::new(sample.header(), &[]), gateway_seq };
    // Texts and numbers only, none of which JSON could refuse.
    let about = serde_json::to_vec(&about).unwrap_or_default();
    Parcel { payload: values(sample.values()), attachment: Some(ZBytes::from(about)) }
}

/// Values as little-endian bytes. `O(values)`, one copy.
pub fn values(values: &[f32]) -> ZBytes {
    let mut bytes = Vec::with_capacity(size_of_val(values));
    for value in values {
        bytes.extend_from_slice(&value.to_le_bytes());
    }
    ZBytes::from(bytes)
}
