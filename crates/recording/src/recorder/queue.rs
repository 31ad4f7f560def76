//! The bounded queue between the ports and the disk, and the thread behind it.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::thread::{self, JoinHandle};
use std::time::Instant;

use wire::now_ns;

use super::drain::{Outlet, Stamp};
use super::{FLUSH_EVERY, Flag, RecordError, RecordSummary};
use crate::message::{GapMessage, Recorded};
use crate::{Channel, GapCounter, RotateSummary, RotatingWriter, WriteError};

/// What the writer's thread is given.
enum Entry {
    Message { channel: Arc<Channel>, sequence: u32, log_time_ns: u64, publish_time_ns: u64, data: Vec<u8> },
    Metadata { name: String, entries: BTreeMap<String, String> },
}

/// The near end of the queue: encodes, counts, notes gaps.
pub struct Sink {
    sender: Sender<Entry>,
    waiting_bytes: Arc<AtomicU64>,
    limit_bytes: u64,
    offset_ns: u64,
    channels: BTreeMap<String, Arc<Channel>>,
    models: BTreeMap<String, String>,
    gaps: GapCounter,
    summary: RecordSummary,
}

/// The far end.
pub struct WriterThread {
    handle: JoinHandle<Result<RotateSummary, WriteError>>,
    failed: Flag,
}

/// Starts the writer's thread.
pub fn start(file: RotatingWriter, limit_bytes: u64, offset_ns: u64) -> (Sink, WriterThread) {
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
    let sink = Sink {
        sender,
        waiting_bytes,
        limit_bytes,
        offset_ns,
        channels: BTreeMap::new(),
        models: BTreeMap::new(),
        gaps: GapCounter::default(),
        summary: RecordSummary::default(),
    };
    (sink, WriterThread { handle, failed })
}

impl Outlet for Sink {
    /// Queues one message; reports a jump in its topic's numbers as a message of its own, in front of it.
    fn put<M: Recorded>(&mut self, topic: &str, stamp: Stamp, message: &M) {
        if let Some(gap) = self.gaps.observe(topic, stamp.boot_id, stamp.seq) {
            self.summary.missing = self.gaps.missing();
            let stamp = Stamp { seq: gap.found_seq, ..stamp };
            self.queue(GapMessage::TOPIC, stamp, &GapMessage::new(topic, gap));
        }
        self.queue(topic, stamp, message);
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
        let _ = self.sender.send(Entry::Metadata { name: format!("softtwin.model.{actuator}"), entries });
    }
}

impl Sink {
    /// What was recorded so far.
    pub fn summary(&self) -> &RecordSummary {
        &self.summary
    }

    /// Closes the queue.
    pub fn into_summary(self) -> RecordSummary {
        self.summary
    }

    fn queue<M: Recorded>(&mut self, topic: &str, stamp: Stamp, message: &M) {
        let mut data = Vec::new();
        message.encode(&mut data);
        let bytes = data.len() as u64;
        if self.waiting_bytes.load(Ordering::Relaxed) + bytes > self.limit_bytes {
            self.summary.dropped += 1;
            return;
        }
        let channel = match self.channels.get(topic) {
            Some(channel) => channel.clone(),
            None => {
                let channel = Arc::new(M::channel(topic));
                self.channels.insert(topic.to_owned(), channel.clone());
                channel
            }
        };
        self.waiting_bytes.fetch_add(bytes, Ordering::Relaxed);
        let entry = Entry::Message {
            channel,
            sequence: stamp.seq as u32, // the format keeps 32 bits; the message has them all
            log_time_ns: now_ns().saturating_add(self.offset_ns),
            publish_time_ns: stamp.t_publish_ns.saturating_add(self.offset_ns),
            data,
        };
        if self.sender.send(entry).is_ok() {
            *self.summary.messages.entry(topic.to_owned()).or_default() += 1;
        } else {
            self.summary.dropped += 1;
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
            Err(_) => Err(RecordError::WriterGone),
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
