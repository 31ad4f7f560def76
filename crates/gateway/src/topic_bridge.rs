//! One local topic on the network: publisher, queryable and local reader.

use crate::link::{Link, count, network};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::time::{Duration, Instant};
use wire::{Topic, TopicKind, WireError};
use zenoh::Wait;
use zenoh::bytes::{Encoding, ZBytes};
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::{Query, Queryable};
use zenoh::sample::Locality;

/// Largest number of waiting requests per topic.
const REQUESTS: usize = 16;
/// Longest wait of a request for a sample: health is published once per second.
const PATIENCE: Duration = Duration::from_secs(2);
/// Time for which a topic stays open after a request, so that repeated requests do not open a reader each.
const LINGER: Duration = Duration::from_secs(5);

/// Local name and query of a request.
pub type Request = (String, Query);

/// One sample, encoded.
#[derive(Debug, Clone)]
pub struct EncodedSample {
    /// JSON, or the values of a field.
    pub payload: ZBytes,
    /// JSON header of a field.
    pub attachment: Option<ZBytes>,
}

/// One local topic on the network.
pub struct TopicBridge {
    /// The local topic.
    pub topic: Topic,
    publisher: Publisher<'static>,
    _queryable: Queryable<()>,
    requests: Receiver<Request>,
    waiting: Vec<(Query, Instant)>,
    lingers_until: Option<Instant>,
}

/// A bridge with its local reader, which exists while there are subscribers or requests.
pub struct ReadBridge<R> {
    pub bridge: TopicBridge,
    /// The local reader.
    pub reader: Option<R>,
    /// The newest sample since the reader was opened.
    pub newest: Option<EncodedSample>,
    is_failed: bool,
}

impl TopicBridge {
    /// Announces the topic on the network.
    ///
    /// # Errors
    /// When the session is closed.
    pub fn declare(link: &Link, topic: Topic) -> anyhow::Result<Self> {
        // Messages wait for slow subscribers; fields are dropped instead and never delay a message.
        let (congestion, priority) = match topic.kind() {
            TopicKind::Field => (CongestionControl::Drop, Priority::DataLow),
            _ => (CongestionControl::Block, Priority::DataHigh),
        };
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

    /// True with a subscriber on the network.
    pub fn has_subscribers(&self) -> bool {
        self.publisher.matching_status().wait().is_ok_and(|status| status.matching())
    }

    /// True if requests wait.
    pub fn has_requests(&self) -> bool {
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
    pub fn send(&self, sample: &EncodedSample, counter: &AtomicU64, longest_us: &AtomicU64) {
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

impl<R> ReadBridge<R> {
    /// A bridge whose topic is not read yet.
    pub fn new(bridge: TopicBridge) -> Self {
        Self { bridge, reader: None, newest: None, is_failed: false }
    }

    /// Opens or closes the reader as required; true if it was opened.
    pub fn adjust(
        &mut self,
        link: &Link,
        now: Instant,
        open: impl FnOnce(&Topic) -> Result<R, WireError>,
    ) -> bool {
        self.bridge.refuse_late(link, now);
        let is_open = self.reader.is_some();
        if !self.bridge.is_wanted(now) {
            (self.reader, self.newest) = (None, None);
        } else if !is_open {
            let opened = open(&self.bridge.topic);
            if let (Err(error), false) = (&opened, self.is_failed) {
                tracing::warn!("{error}; trying again");
            }
            self.is_failed = opened.is_err();
            self.reader = opened.ok();
        }
        self.reader.is_some() && !is_open
    }

    /// Closes a failed reader; the next [`Self::adjust`] reopens it.
    pub fn close(&mut self, error: &WireError) {
        tracing::warn!("{error}; opening the topic again");
        self.reader = None;
    }

    /// Answers all waiting requests with the newest sample, if there is one.
    pub fn answer(&mut self, link: &Link) {
        let Some(newest) = &self.newest else { return };
        let is_field = self.bridge.topic.kind() == TopicKind::Field;
        for (query, _) in self.bridge.waiting.drain(..) {
            reply(link, &query, self.bridge.topic.name(), newest, is_field);
        }
    }
}

/// Queues requests to a local name while the result exists; refuses them if the queue is full.
///
/// # Errors
/// When the session is closed.
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
