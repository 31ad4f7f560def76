//! The bounded queue between the ports and the disk, and the thread behind it.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Instant;

use wire::{Topic, now_ns};

use super::drain::{Outlet, Stamp};
use super::{FLUSH_EVERY, RecordError, RecordSummary};
use crate::message::{GapMessage, Recorded};
use crate::{Channel, GapCounter, RotateSummary, RotatingWriter, WriteError};

/// What the writer's thread is given.
enum Entry {
    Message { channel: Arc<Channel>, sequence: u32, log_time_ns: u64, publish_time_ns: u64, data: Vec<u8> },
    Metadata { name: String, entries: BTreeMap<String, String> },
}

/// The near end of the queue. Each topic's thread has its own [`Sink`] into it.
#[derive(Clone)]
pub struct Queue {
    sender: Sender<Entry>,
    waiting_bytes: Arc<AtomicU64>,
    limit_bytes: u64,
    offset_ns: u64,
    summary: Arc<Mutex<RecordSummary>>,
}

/// Encodes, counts, notes gaps.
pub struct Sink {
    queue: Queue,
    channels: BTreeMap<String, Arc<Channel>>,
    models: BTreeMap<String, String>,
    gaps: GapCounter,
}

/// The far end.
pub struct WriterThread {
    handle: JoinHandle<Result<RotateSummary, WriteError>>,
    failed: Arc<AtomicBool>,
}

/// Starts the writer's thread. It ends when all clones of the queue are gone.
pub fn start(file: RotatingWriter, limit_bytes: u64, offset_ns: u64) -> (Queue, WriterThread) {
    let (sender, receiver) = mpsc::channel();
    let waiting_bytes = Arc::new(AtomicU64::new(0));
    let failed = Arc::new(AtomicBool::new(false));
    let handle = thread::spawn({
        let (waiting, failed) = (waiting_bytes.clone(), failed.clone());
        move || {
            let result = write_all(file, &receiver, &waiting);
            failed.store(result.is_err(), Ordering::Relaxed);
            result
        }
    });
    let queue = Queue { sender, waiting_bytes, limit_bytes, offset_ns, summary: Arc::default() };
    (queue, WriterThread { handle, failed })
}

impl Queue {
    /// A way into the queue.
    pub fn sink(&self) -> Sink {
        Sink {
            queue: self.clone(),
            channels: BTreeMap::new(),
            models: BTreeMap::new(),
            gaps: GapCounter::default(),
        }
    }

    /// What was recorded so far, over all topics.
    pub fn summary(&self) -> MutexGuard<'_, RecordSummary> {
        // Counts are whole after every line: who panicked while holding them left nothing half done.
        self.summary.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes `bytes` of the room there is; false when there is not enough.
    fn reserve(&self, bytes: u64) -> bool {
        let waiting = self.waiting_bytes.fetch_add(bytes, Ordering::Relaxed);
        let fits = waiting + bytes <= self.limit_bytes;
        if !fits {
            self.waiting_bytes.fetch_sub(bytes, Ordering::Relaxed);
        }
        fits
    }
}

impl Outlet for Sink {
    /// Queues one message; reports a jump in its topic's numbers as a message of its own, in front of it.
    fn put<M: Recorded>(&mut self, topic: &str, stamp: Stamp, message: &M) {
        if let Some(gap) = self.gaps.observe(topic, stamp.boot_id, stamp.seq) {
            self.queue.summary().missing += gap.missing();
            let stamp = Stamp { seq: gap.found_seq, ..stamp };
            self.enqueue(GapMessage::TOPIC, stamp, &GapMessage::new(topic, gap));
        }
        self.enqueue(topic, stamp, message);
    }

    /// Notes which model an actuator's states come from, whenever that changes.
    fn model(&mut self, actuator: &str, hash: &str) {
        if self.models.get(actuator).is_some_and(|known| known == hash) {
            return;
        }
        self.models.insert(actuator.to_owned(), hash.to_owned());
        let entries = BTreeMap::from([
            ("actuator".to_owned(), actuator.to_owned()),
            ("model_hash".to_owned(), hash.to_owned()),
        ]);
        // A writer that is gone has said why; the recorder's loop sees it.
        let _ =
            self.queue.sender.send(Entry::Metadata { name: format!("softtwin.model.{actuator}"), entries });
    }
}

impl Sink {
    /// Says what keeps `topic` from being recorded, or that nothing does any more.
    pub fn trouble(&self, topic: &Topic, what: Option<String>) {
        self.queue.summary().set_trouble(topic.name(), what);
    }

    fn enqueue<M: Recorded>(&mut self, topic: &str, stamp: Stamp, message: &M) {
        let mut data = Vec::new();
        message.encode(&mut data);
        let channel = match self.channels.get(topic) {
            Some(channel) => channel.clone(),
            None => {
                let channel = Arc::new(M::channel(topic));
                self.channels.insert(topic.to_owned(), channel.clone());
                channel
            }
        };
        let is_queued = self.queue.reserve(data.len() as u64)
            && self.queue.sender.send(self.entry(channel, stamp, data)).is_ok();
        self.queue.summary().count(topic, is_queued);
    }

    fn entry(&self, channel: Arc<Channel>, stamp: Stamp, data: Vec<u8>) -> Entry {
        Entry::Message {
            channel,
            sequence: stamp.seq as u32, // the format keeps 32 bits; the message has them all
            log_time_ns: now_ns().saturating_add(self.queue.offset_ns),
            publish_time_ns: stamp.t_publish_ns.saturating_add(self.queue.offset_ns),
            data,
        }
    }
}

impl WriterThread {
    /// Whether the disk refused.
    pub fn has_failed(&self) -> bool {
        self.failed.load(Ordering::Relaxed)
    }

    /// Waits until everything is written.
    pub fn join(self) -> Result<RotateSummary, RecordError> {
        match self.handle.join() {
            Ok(result) => Ok(result?),
            Err(_) => Err(RecordError::ThreadGone("writer")),
        }
    }
}

fn write_all(
    mut file: RotatingWriter,
    receiver: &Receiver<Entry>,
    waiting_bytes: &AtomicU64,
) -> Result<RotateSummary, WriteError> {
    let mut flush_at = Instant::now() + FLUSH_EVERY;
    loop {
        match receiver.recv_timeout(flush_at.saturating_duration_since(Instant::now())) {
            Ok(Entry::Message { channel, sequence, log_time_ns, publish_time_ns, data }) => {
                waiting_bytes.fetch_sub(data.len() as u64, Ordering::Relaxed);
                file.message(&channel, sequence, log_time_ns, publish_time_ns, &data)?;
            }
            Ok(Entry::Metadata { name, entries }) => file.metadata(&name, &entries)?,
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return file.finish(),
        }
        if Instant::now() >= flush_at {
            file.flush()?;
            flush_at = Instant::now() + FLUSH_EVERY;
        }
    }
}
