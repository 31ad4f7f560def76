//! The bounded queue between the topics and the disk, and the thread that writes.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use wire::layout::{Layout, Payload, hex};
use wire::{
    AnySample, Command, Estimate, FieldHeader, Grasp, Health, SensorSample, Setpoint, Stamp, State, Target,
    Topic, TopicKind, Valve, WireError, now_ns,
};

use super::summary::{RecordError, RecordSummary};
use crate::message::{self, FieldMessage, GapCounter, GapMessage, Observed, Recorded};
use crate::rotate::{RotateSummary, RotatingWriter};
use crate::writer::{Channel, WriteError};
use wire::thread_group::{ThreadEnded, panic_cause};

/// Longest time between receiving a sample and having it on disk.
pub const FLUSH_EVERY: Duration = Duration::from_millis(500);

/// Entry of the queue.
enum Entry {
    Message { channel: Arc<Channel>, sequence: u32, log_time_ns: u64, publish_time_ns: u64, data: Vec<u8> },
    Metadata { name: String, entries: BTreeMap<String, String> },
    NewFile,
}

/// The end that is filled. Each topic's thread has its own [`QueueSink`].
#[derive(Clone)]
pub struct Queue {
    sender: Sender<Entry>,
    waiting_bytes: Arc<AtomicU64>,
    limit_bytes: u64,
    offset_ns: u64,
    summary: Arc<Mutex<RecordSummary>>,
}

/// Encodes and counts the samples of one topic and notes gaps.
pub struct QueueSink {
    queue: Queue,
    topic: Topic,
    channel: Arc<Channel>,
    gap_channel: Arc<Channel>,
    gaps: GapCounter,
    /// The model of the newest state or field.
    model: Option<[u8; 16]>,
}

/// The end that is emptied.
pub struct WriterThread(JoinHandle<Result<RotateSummary, WriteError>>);

/// Starts the writer's thread. It ends when all clones of the queue are gone. `offset_ns` added to the monotonic clock gives
/// the time since 1970.
///
/// # Errors
/// [`RecordError::Start`].
pub fn start(
    file: RotatingWriter,
    limit_bytes: u64,
    offset_ns: u64,
) -> Result<(Queue, WriterThread), RecordError> {
    let (sender, receiver) = mpsc::channel();
    let waiting_bytes = Arc::new(AtomicU64::new(0));
    let waiting = waiting_bytes.clone();
    let thread = thread::Builder::new().name("writer".into());
    let summary = Arc::<Mutex<RecordSummary>>::default();
    let seen = summary.clone();
    let write = move || write_all(file, &receiver, &waiting, &seen);
    let handle = thread.spawn(write).map_err(RecordError::Start)?;
    let queue = Queue { sender, waiting_bytes, limit_bytes, offset_ns, summary };
    Ok((queue, WriterThread(handle)))
}

impl Queue {
    /// A sink for the samples of `topic`.
    pub fn sink(&self, topic: Topic) -> QueueSink {
        QueueSink {
            queue: self.clone(),
            channel: Arc::new(channel_of(&topic)),
            gap_channel: Arc::new(GapMessage::channel()),
            topic,
            gaps: GapCounter::default(),
            model: None,
        }
    }

    /// Summary so far, over all topics.
    pub fn summary(&self) -> MutexGuard<'_, RecordSummary> {
        lock(&self.summary)
    }

    /// Asks the writer to end its file and to begin the next one, see [`RotatingWriter::begin_new_file`].
    pub fn begin_new_file(&self) {
        // If the writer has ended, the recorder's loop sees it.
        let _ = self.sender.send(Entry::NewFile);
    }

    /// Reserves `bytes` of the queue; false when they do not fit.
    fn reserve(&self, bytes: u64) -> bool {
        let waiting = self.waiting_bytes.fetch_add(bytes, Ordering::Relaxed);
        let fits = waiting + bytes <= self.limit_bytes;
        if !fits {
            self.waiting_bytes.fetch_sub(bytes, Ordering::Relaxed);
        }
        fits
    }
}

impl QueueSink {
    pub fn topic(&self) -> &Topic {
        &self.topic
    }

    /// Sets or clears the error of the topic.
    pub fn set_error(&self, cause: Option<&WireError>) {
        self.queue.summary().set_error(self.topic.name(), cause);
    }

    /// Queues one sample, after a message about the jump in its topic's sequence numbers, if there is one.
    pub fn put(&mut self, sample: &AnySample) {
        let stamp = sample.stamp();
        let Observed { gap, missing } = self.gaps.observe(stamp);
        if missing != 0 {
            self.queue.summary().add_missing(missing);
        }
        if let Some(gap) = gap {
            let mut data = Vec::new();
            GapMessage::new(self.topic.name(), gap).encode(&mut data);
            self.enqueue(self.gap_channel.clone(), stamp, data);
        }
        let model = match sample {
            AnySample::State(state) => Some(state.model_hash),
            AnySample::Field(field) => Some(field.header().model_hash),
            _ => None,
        };
        if let Some(model) = model {
            self.note_model(model);
        }
        self.enqueue(self.channel.clone(), stamp, encode(sample));
    }

    /// Records which model an actuator's states or fields come from, whenever that changes.
    fn note_model(&mut self, model: [u8; 16]) {
        if self.model.replace(model) == Some(model) {
            return;
        }
        let actuator = self.topic.actuator().to_owned();
        let name = format!("softtwin.model.{actuator}");
        let entries =
            BTreeMap::from([("actuator".to_owned(), actuator), ("model_hash".to_owned(), hex(&model))]);
        // If the writer has ended, the recorder's loop sees it.
        let _ = self.queue.sender.send(Entry::Metadata { name, entries });
    }

    fn enqueue(&self, channel: Arc<Channel>, stamp: Stamp, data: Vec<u8>) {
        let (topic, bytes, offset_ns) = (channel.topic.clone(), data.len() as u64, self.queue.offset_ns);
        let entry = Entry::Message {
            channel,
            sequence: stamp.seq as u32, // the format keeps 32 bits; the message has them all
            log_time_ns: now_ns().saturating_add(offset_ns),
            publish_time_ns: stamp.t_publish_ns.saturating_add(offset_ns),
            data,
        };
        let is_queued = self.queue.reserve(bytes) && self.queue.sender.send(entry).is_ok();
        self.queue.summary().count(&topic, is_queued);
    }
}

impl WriterThread {
    /// Whether it ended although the queue is still there: the disk refused, or it panicked.
    pub fn has_ended(&self) -> bool {
        self.0.is_finished()
    }

    /// Waits until everything is written.
    pub fn join(self) -> Result<RotateSummary, RecordError> {
        match self.0.join() {
            Ok(result) => Ok(result?),
            Err(panic) => Err(ThreadEnded { thread: "writer".into(), cause: panic_cause(&*panic) }.into()),
        }
    }
}

fn lock(summary: &Mutex<RecordSummary>) -> MutexGuard<'_, RecordSummary> {
    // Counts are consistent after every statement, also after a panic.
    summary.lock().unwrap_or_else(PoisonError::into_inner)
}

fn write_all(
    mut file: RotatingWriter,
    receiver: &Receiver<Entry>,
    waiting_bytes: &AtomicU64,
    summary: &Mutex<RecordSummary>,
) -> Result<RotateSummary, WriteError> {
    let mut flush_at = Instant::now() + FLUSH_EVERY;
    loop {
        match receiver.recv_timeout(flush_at.saturating_duration_since(Instant::now())) {
            Ok(Entry::Message { channel, sequence, log_time_ns, publish_time_ns, data }) => {
                waiting_bytes.fetch_sub(data.len() as u64, Ordering::Relaxed);
                file.message(&channel, sequence, log_time_ns, publish_time_ns, &data)?;
            }
            Ok(Entry::Metadata { name, entries }) => file.metadata(&name, &entries)?,
            Ok(Entry::NewFile) => file.begin_new_file()?,
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return file.finish(),
        }
        if Instant::now() >= flush_at {
            file.flush()?;
            lock(summary).flushed(file.disk_use());
            flush_at = Instant::now() + FLUSH_EVERY;
        }
    }
}

/// The channel of a topic's messages.
fn channel_of(topic: &Topic) -> Channel {
    let layout: &Layout = match topic.kind() {
        TopicKind::Sensor => SensorSample::LAYOUT,
        TopicKind::State => State::LAYOUT,
        TopicKind::Health => Health::LAYOUT,
        TopicKind::Field => FieldHeader::LAYOUT,
        TopicKind::Grasp => Grasp::LAYOUT,
        TopicKind::Command => Command::LAYOUT,
        TopicKind::Estimate => Estimate::LAYOUT,
        TopicKind::Setpoint | TopicKind::Override => Setpoint::LAYOUT,
        TopicKind::Target => Target::LAYOUT,
        TopicKind::Valve => Valve::LAYOUT,
    };
    message::channel(layout, topic.name())
}

/// The sample as JSON, a field with its values (base64).
fn encode(sample: &AnySample) -> Vec<u8> {
    let mut out = Vec::with_capacity(1536);
    match sample {
        AnySample::Field(field) => FieldMessage::new(field.header(), field.values()).encode(&mut out),
        _ => sample.view().encode(&mut out),
    }
    out
}
