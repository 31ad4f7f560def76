//! States, health, grasps, readings, commands: all of them, as JSON, to subscribers.

use crate::link::{Link, network};
use crate::topic_bridge::{EncodedSample, ReadBridge, TopicBridge};
use recording::message::{GapMessage, Json, Recorded};
use recording::{Gap, GapCounter, Observed};
use std::sync::atomic::Ordering;
use std::sync::mpsc::Receiver;
use std::thread;
use std::time::{Duration, Instant};
use wire::{AnyReader, AnySample, Bus, Waking, WireError};
use zenoh::Wait;
use zenoh::bytes::{Encoding, ZBytes};
use zenoh::pubsub::Publisher;
use zenoh::qos::CongestionControl;

/// Key of messages about losses, without the prefix.
const GAP_NAME: &str = "softtwin/gateway/gap";
/// Interval of checks for subscribers.
const TICK: Duration = Duration::from_millis(50);
/// Interval of reads of open topics. Waiting for each sample's event would save a millisecond and cost the twin a wake-up per
/// sample.
const PACE: Duration = Duration::from_millis(2);
/// Initial capacity for a message.
const BYTES: usize = 1536;

/// Publishes messages until the gateway ends; `bridges` delivers new topics.
///
/// # Errors
/// When the shared memory cannot be opened.
pub fn run(link: &Link, bridges: &Receiver<TopicBridge>) -> anyhow::Result<()> {
    let bus = Bus::open(&link.domain)?;
    let gap_publisher = link
        .session
        .declare_publisher(link.key(GAP_NAME))
        .encoding(Encoding::APPLICATION_JSON)
        .congestion_control(CongestionControl::Block);
    let gap_publisher = network(gap_publisher.wait())?;
    let mut topics = Vec::<MessageTopic>::new();
    let mut check_at = Instant::now();
    while link.is_running() {
        let now = Instant::now();
        if now >= check_at {
            check_at = now + TICK;
            topics.extend(bridges.try_iter().map(MessageTopic::new));
            for topic in &mut topics {
                topic.adjust(link, &bus, now);
            }
        }
        for topic in &mut topics {
            if let Err(error) = topic.pump(link, &gap_publisher) {
                topic.read.close(&error);
            }
        }
        let is_idle = topics.iter().all(|topic| topic.read.reader.is_none());
        thread::sleep(if is_idle { TICK } else { PACE });
    }
    Ok(())
}

struct MessageTopic {
    read: ReadBridge<AnyReader>,
    /// Gaps between the twin and the gateway.
    gaps: GapCounter,
}

impl MessageTopic {
    fn new(bridge: TopicBridge) -> Self {
        Self { read: ReadBridge::new(bridge), gaps: GapCounter::default() }
    }

    fn adjust(&mut self, link: &Link, bus: &Bus, now: Instant) {
        if self.read.adjust(link, now, |topic| AnyReader::attach_as(bus, topic, Waking::Never)) {
            // Samples missed while the topic was closed are no losses.
            self.gaps = GapCounter::default();
        }
    }

    /// Sends waiting samples and answers requests.
    fn pump(&mut self, link: &Link, gap_publisher: &Publisher) -> Result<(), WireError> {
        let Some(reader) = &self.read.reader else { return Ok(()) };
        let (bridge, counters) = (&self.read.bridge, &link.counters);
        while let Some(sample) = reader.next()? {
            let Observed { gap, missing } = self.gaps.observe(sample.stamp());
            // Two's complement: a late sample takes one away.
            counters.lost.fetch_add(missing.cast_unsigned(), Ordering::Relaxed);
            if let Some(gap) = gap {
                report_loss(bridge.topic.name(), gap, gap_publisher);
            }
            let encoded = encode(&sample);
            bridge.send(&encoded, &counters.messages, &counters.longest_send_us);
            self.read.newest = Some(encoded);
        }
        self.read.answer(link);
        Ok(())
    }
}

/// Sample as JSON.
fn encode(sample: &AnySample) -> EncodedSample {
    let mut json = Vec::with_capacity(BYTES);
    Json::new(sample.view()).encode(&mut json);
    EncodedSample { payload: ZBytes::from(json), attachment: None }
}

fn report_loss(topic: &str, gap: Gap, publisher: &Publisher) {
    let missing = gap.missing();
    tracing::warn!("{topic}: {missing} samples were lost before the gateway; is the machine overloaded?");
    let mut json = Vec::new();
    GapMessage::new(topic, gap).encode(&mut json);
    if let Err(error) = publisher.put(json).wait() {
        tracing::warn!("the loss cannot be published: {error}");
    }
}
