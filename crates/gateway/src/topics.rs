//! Local topics on the network. A scan announces new topics and hands each to one of two threads: messages (states, health, readings, ...)
//! go out all of them as JSON, of fields the newest one at a rate or on request, as numbers. A topic is read only while somebody on the
//! network wants it.

use crate::link::{Link, count, network};
use recording::message::{EncodeJson, GapMessage, Json};
use recording::{GapCounter, GapObservation, SequenceGap};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, SyncSender, TrySendError, sync_channel};
use std::thread;
use std::time::{Duration, Instant};
use wire::layout::query_kind;
use wire::{
    AnyReader, AnySample, Bus, FieldSample, KeyExpr, Payload, Stamp, Topic, TopicInfo, TopicKind, Waking,
    WireError,
};
use zenoh::Wait;
use zenoh::bytes::{Encoding, ZBytes};
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::{Query, Queryable};
use zenoh::sample::Locality;

pub const SCAN_EVERY: Duration = Duration::from_millis(250);
/// Longest time for removing files of ended programs, so that a killed twin does not seem alive.
const CLEANING: Duration = Duration::from_millis(5);

pub struct TopicScan {
    bus: Bus,
    keys: Vec<KeyExpr>,
    inlets: Vec<Topic>,
    messages: Sender<TopicBridge>,
    fields: Sender<TopicBridge>,
    handler: QueryHandler,
    seen: BTreeSet<String>,
    queryables: BTreeMap<String, Vec<Queryable<()>>>,
    tokens: BTreeMap<String, LivelinessToken>,
}

impl TopicScan {
    pub fn new(
        link: &Link,
        keys: &[KeyExpr],
        inlets: &[Topic],
        messages: Sender<TopicBridge>,
        fields: Sender<TopicBridge>,
        handler: QueryHandler,
    ) -> Result<Self, WireError> {
        Ok(Self {
            bus: Bus::open(&link.domain)?,
            keys: keys.to_vec(),
            inlets: inlets.to_vec(),
            messages,
            fields,
            handler,
            seen: BTreeSet::new(),
            queryables: BTreeMap::new(),
            tokens: BTreeMap::new(),
        })
    }

    pub fn scan(&mut self, link: &Link) -> anyhow::Result<()> {
        self.bus.clean_up(CLEANING);
        let mut found: Vec<TopicInfo> = Vec::new();
        for key in &self.keys {
            found.extend(self.bus.topics(key)?);
        }
        for info in &found {
            self.announce_topic(link, &info.topic)?;
        }
        self.announce_twins(link, &found)
    }

    /// Announces a new topic, unless its readings come from the network.
    fn announce_topic(&mut self, link: &Link, topic: &Topic) -> anyhow::Result<()> {
        if self.inlets.contains(topic) || self.seen.contains(topic.name()) {
            return Ok(());
        }
        let bridge = TopicBridge::declare(link, topic.clone())?;
        if topic.kind() == TopicKind::State {
            let queryables = self.handler.open(link, topic.actuator())?;
            self.queryables.insert(topic.actuator().to_owned(), queryables);
        }
        self.seen.insert(topic.name().to_owned());
        tracing::info!("{topic} is on the network as {}", link.key(topic.name()));
        // If the receiving thread has ended, the main loop sees it.
        let _ = match topic.kind() {
            TopicKind::Field => self.fields.send(bridge),
            _ => self.messages.send(bridge),
        };
        Ok(())
    }

    /// Declares a token for every actuator whose state has a writer.
    fn announce_twins(&mut self, link: &Link, found: &[TopicInfo]) -> anyhow::Result<()> {
        let lives = |info: &&TopicInfo| info.topic.kind() == TopicKind::State && !info.writers.is_empty();
        let living: BTreeSet<&str> = found.iter().filter(lives).map(|info| info.topic.actuator()).collect();
        for (actuator, _) in self.tokens.extract_if(.., |actuator, _| !living.contains(actuator.as_str())) {
            tracing::info!("the twin of {actuator} has gone");
        }
        for actuator in living {
            if !self.tokens.contains_key(actuator) {
                tracing::info!("the twin of {actuator} is alive");
                let key = link.key(&format!("softtwin/{actuator}/alive"));
                let token = network(link.session.liveliness().declare_token(key).wait())?;
                self.tokens.insert(actuator.to_owned(), token);
            }
        }
        Ok(())
    }
}

// ---- queries on the network ----

/// Largest number of waiting queries.
const QUERIES: usize = 64;

/// Takes queries on the network and passes them to the thread that answers them.
#[derive(Clone)]
pub struct QueryHandler {
    sender: SyncSender<Request>,
}

impl QueryHandler {
    pub fn new() -> (Self, Receiver<Request>) {
        let (sender, receiver) = sync_channel(QUERIES);
        (Self { sender }, receiver)
    }

    /// Takes all kinds of queries for one actuator, as long as the result exists.
    pub fn open(&self, link: &Link, actuator: &str) -> anyhow::Result<Vec<Queryable<()>>> {
        let names = query_kind::ALL.iter().map(|kind| format!("softtwin/{actuator}/{}", kind.name));
        names.map(|name| accept_requests(link, &name, self.sender.clone())).collect()
    }
}

// ---- a topic on the network ----

/// Largest number of waiting requests per topic.
const REQUESTS: usize = 16;
/// Longest wait of a request for a sample: health is published once per second.
const PATIENCE: Duration = Duration::from_secs(2);
/// Time for which a topic stays open after a request, so that repeated requests do not open a reader each.
const LINGER: Duration = Duration::from_secs(5);

/// Local name and query of a request.
pub type Request = (String, Query);

#[derive(Debug, Clone)]
pub struct EncodedSample {
    /// JSON, or the values of a field.
    pub payload: ZBytes,
    /// JSON header of a field.
    pub attachment: Option<ZBytes>,
}

/// One local topic on the network.
pub struct TopicBridge {
    topic: Topic,
    publisher: Publisher<'static>,
    _queryable: Queryable<()>,
    requests: Receiver<Request>,
    waiting: Vec<(Query, Instant)>,
    lingers_until: Option<Instant>,
}

/// A bridge with its local reader, which exists while there are subscribers or requests.
struct ReadBridge {
    bridge: TopicBridge,
    reader: Option<AnyReader>,
    /// The newest sample since the reader was opened.
    newest: Option<EncodedSample>,
    is_failed: bool,
}

impl TopicBridge {
    fn declare(link: &Link, topic: Topic) -> anyhow::Result<Self> {
        let (congestion, priority) = delivery(topic.kind());
        let publisher = link
            .session
            .declare_publisher(link.key(topic.name()))
            .encoding(encoding(topic.kind() == TopicKind::Field))
            .congestion_control(congestion)
            .priority(priority)
            .allowed_destination(Locality::Remote);
        let publisher = network(publisher.wait())?;
        let (sender, requests) = sync_channel(REQUESTS);
        let queryable = accept_requests(link, topic.name(), sender)?;
        Ok(Self {
            topic,
            publisher,
            _queryable: queryable,
            requests,
            waiting: Vec::new(),
            lingers_until: None,
        })
    }

    fn has_subscribers(&self) -> bool {
        self.publisher.matching_status().wait().is_ok_and(|status| status.matching())
    }

    fn has_requests(&self) -> bool {
        !self.waiting.is_empty()
    }

    /// True with a subscriber or within [`LINGER`] of a request.
    fn is_wanted(&mut self, now: Instant) -> bool {
        for (_, query) in self.requests.try_iter() {
            self.waiting.push((query, now + PATIENCE));
            self.lingers_until = Some(now + LINGER);
        }
        self.has_subscribers() || self.lingers_until.is_some_and(|until| now < until)
    }

    /// Sends to all subscribers. Messages wait for the slowest one; a field waits a few milliseconds, then that subscriber misses it
    /// (Zenoh does not report this).
    fn send(&self, sample: &EncodedSample, counter: &AtomicU64, longest_us: &AtomicU64) {
        let begin = Instant::now();
        match self.publisher.put(sample.payload.clone()).attachment(sample.attachment.clone()).wait() {
            Ok(()) => count(counter),
            Err(error) => tracing::warn!("{}: cannot be sent: {error}", self.topic),
        }
        longest_us.fetch_max(begin.elapsed().as_micros() as u64, Ordering::Relaxed);
    }

    /// Refuses requests older than [`PATIENCE`].
    fn refuse_late(&mut self, link: &Link, now: Instant) {
        for (query, _) in self.waiting.extract_if(.., |(_, until)| now >= *until) {
            let seconds = PATIENCE.as_secs();
            let text = format!("{}: no sample within {seconds} s; is the twin running?", self.topic);
            refuse(&query, &text, &link.counters.refusals);
        }
    }
}

impl ReadBridge {
    fn new(bridge: TopicBridge) -> Self {
        Self { bridge, reader: None, newest: None, is_failed: false }
    }

    /// Opens or closes the reader as required; true if it was opened.
    fn adjust(&mut self, link: &Link, bus: &Bus, now: Instant) -> bool {
        self.bridge.refuse_late(link, now);
        let is_open = self.reader.is_some();
        if !self.bridge.is_wanted(now) {
            (self.reader, self.newest) = (None, None);
        } else if !is_open {
            let opened = AnyReader::attach_as(bus, &self.bridge.topic, Waking::Never);
            if let (Err(error), false) = (&opened, self.is_failed) {
                tracing::warn!("{error}; trying again");
            }
            self.is_failed = opened.is_err();
            self.reader = opened.ok();
        }
        self.reader.is_some() && !is_open
    }

    /// Closes a failed reader; the next [`Self::adjust`] reopens it.
    fn close(&mut self, error: &WireError) {
        tracing::warn!("{error}; opening the topic again");
        self.reader = None;
    }

    /// Answers all waiting requests with the newest sample, if there is one.
    fn answer(&mut self, link: &Link) {
        let Some(newest) = &self.newest else { return };
        let is_field = self.bridge.topic.kind() == TopicKind::Field;
        for (query, _) in self.bridge.waiting.drain(..) {
            reply(link, &query, self.bridge.topic.name(), newest, is_field);
        }
    }
}

/// Queues requests to a local name while the result exists; refuses them if the queue is full.
pub fn accept_requests(
    link: &Link,
    name: &str,
    sender: SyncSender<Request>,
) -> anyhow::Result<Queryable<()>> {
    let (name, counters, key) = (name.to_owned(), link.counters.clone(), link.key(name));
    let queryable = link.session.declare_queryable(key).callback(move |query| {
        if let Err(TrySendError::Full((_, query)) | TrySendError::Disconnected((_, query))) =
            sender.try_send((name.clone(), query))
        {
            refuse(&query, "too many requests wait here; ask again later", &counters.refusals);
        }
    });
    network(queryable.wait())
}

/// Messages wait for slow subscribers. Fields are dropped instead, so that they never delay a message.
pub fn delivery(kind: TopicKind) -> (CongestionControl, Priority) {
    match kind {
        TopicKind::Field => (CongestionControl::Drop, Priority::DataLow),
        _ => (CongestionControl::Block, Priority::DataHigh),
    }
}

/// Encoding: raw values of a field, JSON otherwise.
fn encoding(is_field: bool) -> Encoding {
    if is_field {
        Encoding::APPLICATION_OCTET_STREAM.with_schema("f32le")
    } else {
        Encoding::APPLICATION_JSON
    }
}

/// Answers one request to a local name.
pub fn reply(link: &Link, query: &Query, name: &str, sample: &EncodedSample, is_field: bool) {
    let reply = query
        .reply(link.key(name), sample.payload.clone())
        .attachment(sample.attachment.clone())
        .encoding(encoding(is_field));
    match reply.wait() {
        Ok(()) => count(&link.counters.answers),
        Err(error) => tracing::debug!("{name}: the client has ended: {error}"),
    }
}

/// Replies with an error and counts it.
pub fn refuse(query: &Query, text: &str, counter: &AtomicU64) {
    count(counter);
    if let Err(error) = query.reply_err(text).encoding(Encoding::TEXT_PLAIN).wait() {
        tracing::debug!("{}: the client has ended: {error}", query.key_expr());
    }
}

// ---- messages ----

/// Key of messages about losses, without the prefix.
const GAP_NAME: &str = "softtwin/gateway/gap";
/// Interval of checks for subscribers and requests, and so the delay before the first sample for a new one.
const TICK: Duration = Duration::from_millis(50);
/// Interval of reads of open topics. Waiting for each sample's event would save a millisecond and cost the twin a wake-up per
/// sample.
const PACE: Duration = Duration::from_millis(2);
/// Initial capacity for a message.
const BYTES: usize = 1536;

/// Publishes messages until the gateway ends; `bridges` delivers new topics.
pub fn run_messages(link: &Link, bridges: &Receiver<TopicBridge>) -> anyhow::Result<()> {
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
    read: ReadBridge,
    /// Gaps between the twin and the gateway.
    gaps: GapCounter,
}

impl MessageTopic {
    fn new(bridge: TopicBridge) -> Self {
        Self { read: ReadBridge::new(bridge), gaps: GapCounter::default() }
    }

    fn adjust(&mut self, link: &Link, bus: &Bus, now: Instant) {
        if self.read.adjust(link, bus, now) {
            // Samples missed while the topic was closed are no losses.
            self.gaps = GapCounter::default();
        }
    }

    /// Sends waiting samples and answers requests.
    fn pump(&mut self, link: &Link, gap_publisher: &Publisher) -> Result<(), WireError> {
        let Some(reader) = &self.read.reader else { return Ok(()) };
        let (bridge, counters) = (&self.read.bridge, &link.counters);
        while let Some(sample) = reader.next()? {
            let GapObservation { gap, missing } = self.gaps.observe(sample.stamp());
            // Two's complement: a late sample takes one away.
            counters.lost.fetch_add(missing.cast_unsigned(), Ordering::Relaxed);
            if let Some(gap) = gap {
                report_loss(bridge.topic.name(), gap, gap_publisher);
            }
            let encoded = encoded_message(&sample);
            bridge.send(&encoded, &counters.messages, &counters.longest_send_us);
            self.read.newest = Some(encoded);
        }
        self.read.answer(link);
        Ok(())
    }
}

fn encoded_message(sample: &AnySample) -> EncodedSample {
    let mut json = Vec::with_capacity(BYTES);
    Json::new(sample.view()).encode(&mut json);
    EncodedSample { payload: ZBytes::from(json), attachment: None }
}

fn report_loss(topic: &str, gap: SequenceGap, publisher: &Publisher) {
    let missing = gap.missing();
    tracing::warn!("{topic}: {missing} samples were lost before the gateway; is the machine overloaded?");
    let mut json = Vec::new();
    GapMessage::new(topic, gap).encode(&mut json);
    if let Err(error) = publisher.put(json).wait() {
        tracing::warn!("the loss cannot be published: {error}");
    }
}

// ---- fields ----

/// Publishes fields until the gateway ends, one per topic and `period`; `bridges` delivers new topics.
pub fn run_fields(link: &Link, bridges: &Receiver<TopicBridge>, period: Duration) -> anyhow::Result<()> {
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
    read: ReadBridge,
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
        if self.read.adjust(link, bus, now) {
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
            && let AnySample::Field(field) = &sample
        {
            let stamp = sample.stamp();
            let encoded = encoded_field(field, is_sent.then_some(self.sent + 1));
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
        let replaced = self.gaps.observe(stamp).gap.map_or(0, SequenceGap::missing);
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

/// Attachment of a field: its header and its number.
#[derive(Serialize)]
struct FieldDescription<'a> {
    #[serde(flatten)]
    header: Json<'a>,
    #[serde(skip_serializing_if = "Option::is_none")]
    gateway_seq: Option<u64>,
}

/// The values in memory order, with the header as JSON attachment.
fn encoded_field(sample: &FieldSample, gateway_seq: Option<u64>) -> EncodedSample {
    let description = FieldDescription { header: Json::new(sample.header().view()), gateway_seq };
    // Strings and numbers only: serialisation cannot fail.
    let description = serde_json::to_vec(&description).unwrap_or_default();
    EncodedSample { payload: little_endian(sample.values()), attachment: Some(ZBytes::from(description)) }
}

/// Values as little-endian bytes. `O(values)`, one copy.
pub fn little_endian(values: &[f32]) -> ZBytes {
    let mut bytes = Vec::with_capacity(size_of_val(values));
    for value in values {
        bytes.extend_from_slice(&value.to_le_bytes());
    }
    ZBytes::from(bytes)
}
