//! One topic on its way out: a publisher for those who listen, a queryable for those who ask.

use crate::link::{Link, count, network};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::{Duration, Instant};
use wire::{Topic, TopicKind};
use zenoh::Wait;
use zenoh::bytes::{Encoding, ZBytes};
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::{Query, Queryable};
use zenoh::sample::Locality;

/// Requests that may wait for one topic.
const REQUESTS: usize = 16;
/// How long a request waits for a sample: health comes once a second.
const PATIENCE: Duration = Duration::from_secs(2);
/// How long a topic stays open after the last request: who asks again and again should not make the twin see a new reader
/// each time.
const LINGER: Duration = Duration::from_secs(5);

/// One sample in its form for the network.
#[derive(Debug, Clone)]
pub struct Parcel {
    /// JSON, or the values of a field.
    pub payload: ZBytes,
    /// JSON beside the values of a field.
    pub attachment: Option<ZBytes>,
}

/// One topic on its way out.
pub struct Lane {
    /// The local topic.
    pub topic: Topic,
    publisher: Publisher<'static>,
    _queryable: Queryable<()>,
    requests: Receiver<Query>,
    waiting: Vec<(Query, Instant)>,
    lingers_until: Option<Instant>,
}

impl Lane {
    /// Announces the topic on the network.
    ///
    /// # Errors
    /// When the session is closed.
    pub fn declare(link: &Link, topic: Topic) -> anyhow::Result<Self> {
        let key = link.topic_key(&topic);
        let is_field = topic.kind() == TopicKind::Field;
        // What must not be lost waits for its readers; of fields the newest wins, and they never stand before a state.
        let (congestion, priority) = match is_field {
            true => (CongestionControl::Drop, Priority::DataLow),
            false => (CongestionControl::Block, Priority::DataHigh),
        };
        let publisher = link
            .session
            .declare_publisher(key.clone())
            .encoding(encoding(is_field))
            .congestion_control(congestion)
            .priority(priority)
            .allowed_destination(Locality::Remote);
        let (sender, requests) = sync_channel::<Query>(REQUESTS);
        let counters = link.counters.clone();
        let queryable = link.session.declare_queryable(key).callback(move |query| {
            if let Err(refused) = sender.try_send(query) {
                let (std::sync::mpsc::TrySendError::Full(query)
                | std::sync::mpsc::TrySendError::Disconnected(query)) = refused;
                refuse(&query, "too many requests wait for this topic; ask again later", &counters.refusals);
            }
        });
        Ok(Self {
            topic,
            publisher: network(publisher.wait())?,
            _queryable: network(queryable.wait())?,
            requests,
            waiting: Vec::new(),
            lingers_until: None,
        })
    }

    /// Whether somebody out there subscribes.
    pub fn is_heard(&self) -> bool {
        self.publisher.matching_status().wait().is_ok_and(|status| status.matching())
    }

    /// Whether somebody subscribes or asked a short while ago: only then is the topic read at all.
    pub fn is_wanted(&mut self, now: Instant) -> bool {
        for query in self.requests.try_iter() {
            self.waiting.push((query, now + PATIENCE));
            self.lingers_until = Some(now + LINGER);
        }
        self.is_heard() || self.lingers_until.is_some_and(|until| now < until)
    }

    /// Whether requests wait.
    pub fn is_asked(&self) -> bool {
        !self.waiting.is_empty()
    }

    /// Sends to all who subscribe. Takes as long as the slowest of them needs to make room (of fields: some milliseconds at
    /// most, then this one is skipped for it; the engine does not say so).
    pub fn send(&self, parcel: &Parcel, counter: &AtomicU64, longest_us: &AtomicU64) {
        let begin = Instant::now();
        match self.publisher.put(parcel.payload.clone()).attachment(parcel.attachment.clone()).wait() {
            Ok(()) => count(counter),
            Err(error) => tracing::warn!("{}: cannot be sent: {error}", self.topic),
        }
        longest_us.fetch_max(begin.elapsed().as_micros() as u64, Ordering::Relaxed);
    }

    /// Answers all requests that wait.
    pub fn answer(&mut self, link: &Link, parcel: &Parcel) {
        let encoding = encoding(self.topic.kind() == TopicKind::Field);
        for (query, _) in self.waiting.drain(..) {
            reply(link, &query, self.publisher.key_expr().as_str(), parcel, encoding.clone());
        }
    }

    /// Gives up on requests that have waited long enough.
    pub fn give_up(&mut self, link: &Link, now: Instant) {
        let topic = &self.topic;
        self.waiting.retain(|(query, until)| {
            let is_over = now >= *until;
            if is_over {
                let text =
                    format!("{topic}: nothing came within {} s; is the twin running?", PATIENCE.as_secs());
                refuse(query, &text, &link.counters.refusals);
            }
            !is_over
        });
    }
}

/// Values travel as they are, everything else as JSON.
pub fn encoding(is_field: bool) -> Encoding {
    if is_field {
        Encoding::APPLICATION_OCTET_STREAM.with_schema("f32le")
    } else {
        Encoding::APPLICATION_JSON
    }
}

/// Answers one request.
pub fn reply(link: &Link, query: &Query, key: &str, parcel: &Parcel, encoding: Encoding) {
    let reply =
        query.reply(key, parcel.payload.clone()).attachment(parcel.attachment.clone()).encoding(encoding);
    match reply.wait() {
        Ok(()) => count(&link.counters.answers),
        Err(error) => tracing::debug!("{key}: who asked has gone: {error}"),
    }
}

/// Says why there is no answer.
pub fn refuse(query: &Query, text: &str, counter: &AtomicU64) {
    count(counter);
    if let Err(error) = query.reply_err(text).encoding(Encoding::TEXT_PLAIN).wait() {
        tracing::debug!("{}: who asked has gone: {error}", query.key_expr());
    }
}
