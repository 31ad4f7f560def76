//! Fields: the newest one, at a fixed rate or on request; read only with subscribers or requests.

use crate::link::Link;
use crate::topic_bridge::{EncodedSample, ReadBridge, TopicBridge};
use recording::message::Json;
use recording::{Gap, GapCounter};
use serde::Serialize;
use std::sync::atomic::Ordering;
use std::sync::mpsc::Receiver;
use std::thread;
use std::time::{Duration, Instant};
use wire::{Bus, FieldHeader, FieldReader, FieldSample, Payload, Stamp, Waking, WireError};
use zenoh::bytes::ZBytes;

/// Longest sleep: delay before the first field for a new subscriber or request.
const TICK: Duration = Duration::from_millis(50);

/// Publishes fields until the gateway ends, one per topic and `period`; `bridges` delivers new topics.
///
/// # Errors
/// When the shared memory cannot be opened.
pub fn run(link: &Link, bridges: &Receiver<TopicBridge>, period: Duration) -> anyhow::Result<()> {
    let bus = Bus::open(&link.domain)?;
    let mut topics = Vec::<FieldTopic>::new();
    while link.is_running() {
        topics.extend(bridges.try_iter().map(FieldTopic::new));
        let now = Instant::now();
        for topic in &mut topics {
            topic.update(link, &bus, now, period);
        }
        let next = topics.iter().filter_map(FieldTopic::due).min().unwrap_or(now + TICK).min(now + TICK);
        thread::sleep(next.saturating_duration_since(Instant::now()));
    }
    Ok(())
}

struct FieldTopic {
    read: ReadBridge<FieldReader>,
    due: Instant,
    /// Fields sent so far: their number, in which subscribers see fields lost in the network.
    sent: u64,
    /// Gaps between sent fields: fields replaced by newer ones.
    gaps: GapCounter,
}

impl FieldTopic {
    fn new(bridge: TopicBridge) -> Self {
        Self { read: ReadBridge::new(bridge), due: Instant::now(), sent: 0, gaps: GapCounter::default() }
    }

    /// Time of the next field; `None` while the topic is not read.
    fn due(&self) -> Option<Instant> {
        self.read.reader.as_ref().map(|_| self.due)
    }

    fn update(&mut self, link: &Link, bus: &Bus, now: Instant, period: Duration) {
        if self.read.adjust(link, now, |topic| FieldReader::attach_as(bus, topic, Waking::Never)) {
            self.due = now;
        }
        if let Err(error) = self.pump(link, now, period) {
            self.read.close(&error);
        }
    }

    fn pump(&mut self, link: &Link, now: Instant, period: Duration) -> Result<(), WireError> {
        let Some(reader) = &self.read.reader else { return Ok(()) };
        let is_due = now >= self.due;
        let is_sent = is_due && self.read.bridge.has_subscribers();
        if (is_due || self.read.bridge.has_requests())
            && let Some(sample) = reader.newest()?
        {
            let stamp = stamp(&sample);
            let encoded = encode(&sample, is_sent.then_some(self.sent + 1));
            drop(sample); // sending may block
            if is_sent {
                self.send(link, &encoded, stamp);
            }
            self.read.newest = Some(encoded);
        }
        if is_due {
            self.schedule_next(link, now, period, is_sent);
        }
        self.read.answer(link);
        Ok(())
    }

    fn send(&mut self, link: &Link, sample: &EncodedSample, stamp: Stamp) {
        let (counters, bridge) = (&link.counters, &self.read.bridge);
        let replaced = self.gaps.observe(stamp).gap.map_or(0, Gap::missing);
        counters.replaced.fetch_add(replaced, Ordering::Relaxed);
        self.sent += 1;
        bridge.send(sample, &counters.fields, &counters.longest_send_us);
    }

    /// Advances by one period, or restarts after missed periods. Without subscribers no field counts as replaced or late.
    fn schedule_next(&mut self, link: &Link, now: Instant, period: Duration, is_sent: bool) {
        let late = now.saturating_duration_since(self.due).as_nanos() / period.as_nanos().max(1);
        self.due = if late == 0 { self.due + period } else { now + period };
        if is_sent {
            link.counters.late_periods.fetch_add(late as u64, Ordering::Relaxed);
        } else {
            self.gaps = GapCounter::default();
        }
    }
}

fn stamp(sample: &FieldSample) -> Stamp {
    let FieldHeader { boot_id, seq, t_sensor_ns, t_publish_ns, .. } = *sample.header();
    Stamp { boot_id, seq, t_sensor_ns, t_publish_ns }
}

/// Attachment of a field: its header and its number.
#[derive(Serialize)]
struct About<'a> {
    #[serde(flatten)]
    header: Json<'a>,
    #[serde(skip_serializing_if = "Option::is_none")]
    gateway_seq: Option<u64>,
}

/// The values in memory order, with the header as JSON attachment.
fn encode(sample: &FieldSample, gateway_seq: Option<u64>) -> EncodedSample {
    let about = About { header: Json::new(sample.header().view()), gateway_seq };
    // Strings and numbers only: serialisation cannot fail.
    let about = serde_json::to_vec(&about).unwrap_or_default();
    EncodedSample { payload: values(sample.values()), attachment: Some(ZBytes::from(about)) }
}

/// Values as little-endian bytes. `O(values)`, one copy.
pub fn values(values: &[f32]) -> ZBytes {
    let mut bytes = Vec::with_capacity(size_of_val(values));
    for value in values {
        bytes.extend_from_slice(&value.to_le_bytes());
    }
    ZBytes::from(bytes)
}
