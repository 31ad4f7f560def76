//! States, health, grasps, readings, commands: every single one, as JSON, to those who subscribe.

use crate::lane::{Lane, Parcel};
use crate::link::{Link, network};
use recording::message::{GapMessage, Recorded};
use recording::{GapCounter, Outlet, Port, Stamp};
use std::sync::atomic::Ordering;
use std::sync::mpsc::Receiver;
use std::thread;
use std::time::{Duration, Instant};
use wire::{Bus, Waking};
use zenoh::Wait;
use zenoh::bytes::{Encoding, ZBytes};
use zenoh::pubsub::Publisher;
use zenoh::qos::CongestionControl;

/// Where losses are told, behind the prefix.
pub const GAP_KEY: &str = "softtwin/gateway/gap";
/// How often it is looked who subscribes.
const TICK: Duration = Duration::from_millis(50);
/// How often open topics are emptied. Waiting for each sample's event would be sooner by a millisecond, and the twin would
/// pay for every wake-up; ports that are never woken cost it none.
const PACE: Duration = Duration::from_millis(2);

/// Moves messages until the gateway ends; `news` brings lanes.
///
/// # Errors
/// When the domain cannot be joined.
pub fn run(link: &Link, news: &Receiver<Lane>) -> anyhow::Result<()> {
    let bus = Bus::open(&link.domain)?;
    let mut gaps = Gaps::declare(link)?;
    let mut flows: Vec<Flow> = Vec::new();
    let mut look_at = Instant::now();
    while link.goes_on() {
        let now = Instant::now();
        if now >= look_at {
            look_at = now + TICK;
            flows.extend(news.try_iter().map(Flow::new));
            for flow in &mut flows {
                flow.adjust(link, &bus, now);
            }
        }
        for flow in &mut flows {
            flow.pump(link, &mut gaps);
        }
        let is_idle = flows.iter().all(|flow| flow.port.is_none());
        thread::sleep(if is_idle { TICK } else { PACE });
    }
    Ok(())
}

/// One topic on its way: its port exists while somebody wants it.
struct Flow {
    lane: Lane,
    port: Option<Port>,
    newest: Option<Parcel>,
    is_refused: bool,
}

impl Flow {
    fn new(lane: Lane) -> Self {
        Self { lane, port: None, newest: None, is_refused: false }
    }

    /// Opens or closes the port.
    fn adjust(&mut self, link: &Link, bus: &Bus, now: Instant) {
        self.lane.give_up(link, now);
        match (self.lane.is_wanted(now), self.port.is_some()) {
            (true, false) => self.open(bus),
            (false, true) => (self.port, self.newest) = (None, None),
            _ => {}
        }
    }

    fn open(&mut self, bus: &Bus) {
        let opened = Port::open(bus, &self.lane.topic, Waking::Never);
        if let (Err(error), false) = (&opened, self.is_refused) {
            tracing::warn!("{error}; it is tried again");
        }
        self.is_refused = opened.is_err();
        self.port = opened.ok();
    }

    /// Hands on what waits; a port that broke is closed, and opened again with the next look.
    fn pump(&mut self, link: &Link, gaps: &mut Gaps) {
        let Some(port) = &self.port else { return };
        let mut sender = Sender { link, lane: &self.lane, newest: &mut self.newest, gaps };
        let drained = port.drain(&mut sender);
        if self.lane.is_asked()
            && let Some(newest) = &self.newest
        {
            self.lane.answer(link, newest);
        }
        if let Err(error) = drained {
            tracing::warn!("{error}; the topic is opened again");
            self.port = None;
        }
    }
}

/// Losses on the way from the twin to the gateway.
struct Gaps {
    counter: GapCounter,
    publisher: Publisher<'static>,
}

impl Gaps {
    fn declare(link: &Link) -> anyhow::Result<Self> {
        let publisher = link
            .session
            .declare_publisher(link.key(GAP_KEY))
            .encoding(Encoding::APPLICATION_JSON)
            .congestion_control(CongestionControl::Block);
        Ok(Self { counter: GapCounter::default(), publisher: network(publisher.wait())? })
    }

    fn observe(&mut self, link: &Link, topic: &str, stamp: Stamp) {
        let Some(gap) = self.counter.observe(topic, stamp.boot_id, stamp.seq) else { return };
        link.counters.lost.fetch_add(gap.missing(), Ordering::Relaxed);
        tracing::warn!(
            "{topic}: {} samples were lost before the gateway; is the machine overloaded?",
            gap.missing()
        );
        let mut json = Vec::new();
        GapMessage::new(topic, gap).encode(&mut json);
        if let Err(error) = self.publisher.put(json).wait() {
            tracing::warn!("the loss cannot be told: {error}");
        }
    }

    /// A topic that was not read for a while has lost nothing.
    fn forget(&mut self, topic: &str) {
        self.counter.forget(topic);
    }
}

/// Takes the messages of one port.
struct Sender<'a> {
    link: &'a Link,
    lane: &'a Lane,
    newest: &'a mut Option<Parcel>,
    gaps: &'a mut Gaps,
}

impl Outlet for Sender<'_> {
    fn put<M: Recorded>(&mut self, topic: &str, stamp: Stamp, message: &M) {
        if self.newest.is_none() {
            self.gaps.forget(topic);
        }
        self.gaps.observe(self.link, topic, stamp);
        let mut json = Vec::with_capacity(1536);
        message.encode(&mut json);
        let parcel = Parcel { payload: ZBytes::from(json), attachment: None };
        let counters = &self.link.counters;
        self.lane.send(&parcel, &counters.messages, &counters.longest_send_us);
        *self.newest = Some(parcel);
    }

    fn model(&mut self, _actuator: &str, _hash: &str) {}
}
