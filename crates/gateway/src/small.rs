//! States, health, grasps, readings, commands: every single one, as JSON, to those who subscribe.

use crate::lane::{Lane, Parcel};
use crate::link::{Link, network};
use recording::message::{GapMessage, Recorded};
use recording::{GapCounter, Outlet, Port, Stamp};
use std::sync::atomic::Ordering;
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};
use wire::{Bus, WakeSet, Wakeable};
use zenoh::Wait;
use zenoh::bytes::{Encoding, ZBytes};
use zenoh::pubsub::Publisher;
use zenoh::qos::CongestionControl;

/// Where losses are told, behind the prefix.
pub const GAP_KEY: &str = "softtwin/gateway/gap";
/// How often it is looked who subscribes; the longest sleep.
const TICK: Duration = Duration::from_millis(50);

/// Moves messages until the gateway ends; `news` brings lanes.
///
/// # Errors
/// When the domain cannot be joined.
pub fn run(link: &Link, news: &Receiver<Lane>) -> anyhow::Result<()> {
    let bus = Bus::open(&link.domain)?;
    let mut gaps = Gaps::declare(link)?;
    let mut flows: Vec<Flow> = Vec::new();
    let mut wakes = WakeSet::new([]);
    let mut look_at = Instant::now();
    while !link.is_stopped() {
        let now = Instant::now();
        if now >= look_at {
            look_at = now + TICK;
            flows.extend(news.try_iter().map(Flow::new));
            let changed =
                flows.iter_mut().map(|flow| flow.adjust(link, &bus, now)).filter(|changed| *changed).count();
            if changed > 0 {
                wakes = WakeSet::new(flows.iter().filter_map(Flow::wakeable));
            }
        }
        wakes.wait(flows.iter().filter_map(Flow::wakeable), look_at.saturating_duration_since(now))?;
        let broken = flows.iter_mut().map(|flow| flow.pump(link, &mut gaps)).filter(|good| !good).count();
        if broken > 0 {
            wakes = WakeSet::new(flows.iter().filter_map(Flow::wakeable));
        }
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

    fn wakeable(&self) -> Option<&dyn Wakeable> {
        self.port.as_ref().map(Port::wakeable)
    }

    /// Opens or closes the port; whether that changed anything.
    fn adjust(&mut self, link: &Link, bus: &Bus, now: Instant) -> bool {
        self.lane.give_up(link, now);
        match (self.lane.is_wanted(now), self.port.is_some()) {
            (true, false) => self.open(bus),
            (false, true) => {
                (self.port, self.newest) = (None, None);
                true
            }
            _ => false,
        }
    }

    fn open(&mut self, bus: &Bus) -> bool {
        let opened = Port::open(bus, &self.lane.topic, false);
        if let (Err(error), false) = (&opened, self.is_refused) {
            tracing::warn!("{error}; it is tried again");
        }
        self.is_refused = opened.is_err();
        self.port = opened.unwrap_or_default();
        self.port.is_some()
    }

    /// Hands on what waits; false when the port broke and was closed.
    fn pump(&mut self, link: &Link, gaps: &mut Gaps) -> bool {
        let Some(port) = &self.port else { return true };
        let drained = port.drain(&mut Sender { link, lane: &self.lane, newest: &mut self.newest, gaps });
        if self.lane.is_asked()
            && let Some(newest) = &self.newest
        {
            self.lane.answer(link, newest);
        }
        let Err(error) = drained else { return true };
        tracing::warn!("{error}; the topic is opened again");
        self.port = None;
        false
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
        self.lane.send(&parcel, &self.link.counters.messages);
        *self.newest = Some(parcel);
    }

    fn model(&mut self, _actuator: &str, _hash: &str) {}
}
