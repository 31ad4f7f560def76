//! Takes everything off the wire and hands it to a writer that may wait for the disk.
//!
//! ```text
//! look ──topics──> run ──begins──> lane, lane, ... ──messages──> queue ──> writer ──> disk
//! ```
//!
//! Each topic has a thread of its own that receives and encodes (a topic's buffer keeps 2 s at 1 kHz), one thread looks for
//! topics, one compresses, writes and syncs. Only the last two ever wait for a disk, and a topic that is being opened. Between
//! lanes and writer lies a queue bounded in bytes; what does not fit is dropped and counted, so that a slow disk costs
//! messages and never memory.

mod crew;
mod drain;
mod lane;
mod look;
mod queue;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use thiserror::Error;
use wire::{Domain, KeyExpr, Topic, TopicKind, WireError, now_ns};

use crate::{RotateOptions, RotateSummary, RotatingWriter, WriteError};
use crew::{Crew, WAIT};
pub use drain::{Outlet, Port, Stamp};
use lane::Opened;
use look::Look;
use queue::{Queue, WriterThread};

/// What is recorded, and where to.
#[derive(Debug, Clone)]
pub struct RecorderOptions {
    /// Topics, as key expressions.
    pub keys: Vec<KeyExpr>,
    /// Whole fields too: half a megabyte a sample at full size.
    pub with_fields: bool,
    /// The file, or what the files' names begin with when rotating.
    pub path: PathBuf,
    /// When a new file is begun.
    pub rotate: RotateOptions,
    /// What waits for the disk, at most, bytes.
    pub queue_bytes: u64,
}

/// Everything is on disk at the latest so long after it was received.
pub const FLUSH_EVERY: Duration = Duration::from_millis(500);

// What the threads are called when one of them is gone.
const LOOK: &str = "look for topics";
const READER: &str = "reader";

/// Why recording ended early.
#[derive(Debug, Error)]
pub enum RecordError {
    /// The shared memory.
    #[error(transparent)]
    Wire(#[from] WireError),
    /// The disk.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// A thread is gone without an error of its own.
    #[error("the recorder's {0} stopped without a word; this is a defect, please report it")]
    ThreadGone(&'static str),
}

/// What was recorded.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RecordSummary {
    /// Messages by topic.
    pub messages: BTreeMap<String, u64>,
    /// Samples that were published and never reached the recorder, by jumps in the sequence numbers.
    pub missing: u64,
    /// Messages that were received and dropped because the disk was too slow.
    pub dropped: u64,
    /// What cannot be recorded at the moment, and why: by topic, or `topics` when they cannot be listed. Tried again and again.
    pub troubles: BTreeMap<String, String>,
    /// The files; known at the end.
    pub files: RotateSummary,
}

impl RecordSummary {
    fn count(&mut self, topic: &str, is_queued: bool) {
        match self.messages.get_mut(topic) {
            _ if !is_queued => self.dropped += 1,
            Some(count) => *count += 1,
            None => _ = self.messages.insert(topic.to_owned(), 1),
        }
    }

    fn set_trouble(&mut self, whom: &str, what: Option<String>) {
        match what {
            Some(what) => _ = self.troubles.insert(whom.to_owned(), what),
            None => _ = self.troubles.remove(whom),
        }
    }
}

/// A recording in progress.
pub struct Recorder {
    domain: Domain,
    options: RecorderOptions,
    news: Receiver<Look>,
    // In front of the queue's end: the threads take what is there before they go.
    crew: Crew,
    queue: Queue,
    writer: WriterThread,
}

impl Recorder {
    /// Opens the first file and every topic that is there already.
    ///
    /// # Errors
    /// [`RecordError`], also when one of these topics cannot be read. Later ones are tried again and stand in
    /// [`RecordSummary::troubles`] meanwhile.
    pub fn start(domain: &Domain, options: RecorderOptions) -> Result<Self, RecordError> {
        let (place, keys) = (domain.clone(), options.keys.clone());
        Self::start_with(domain, options, || look::eye(place, keys))
    }

    /// As [`Self::start`], with an eye of one's own.
    fn start_with<E: FnMut() -> Look>(
        domain: &Domain,
        options: RecorderOptions,
        eye: impl FnOnce() -> E + Send + 'static,
    ) -> Result<Self, RecordError> {
        let mut file = RotatingWriter::create(&options.path, options.rotate)?;
        let offset_ns = wall_offset_ns();
        file.metadata("softtwin.recording", &about(&options, offset_ns))?;
        file.flush()?;
        let (queue, writer) = queue::start(file, options.queue_bytes, offset_ns);
        let (sender, news) = mpsc::channel();
        let mut crew = Crew::default();
        crew.begin(move |stop| look::keep_looking(eye(), &sender, stop));
        let mut recorder = Self { domain: domain.clone(), options, news, crew, queue, writer };
        match recorder.begin() {
            Ok(()) => Ok(recorder),
            Err(error) => {
                recorder.take_back();
                Err(error)
            }
        }
    }

    /// Waits until what is there now is open. A topic that somebody is just making or removing is not waited for.
    fn begin(&mut self) -> Result<(), RecordError> {
        let topics = self.news.recv().map_err(|_| RecordError::ThreadGone(LOOK))??;
        let tries: Vec<_> = topics.into_iter().filter_map(|topic| self.follow(topic)).collect();
        for opened in tries {
            match opened.recv().map_err(|_| RecordError::ThreadGone(READER))? {
                Ok(()) | Err(WireError::InFlux { .. }) => {}
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }

    /// Removes a file that holds nothing: it would stand in the way of the next start.
    fn take_back(self) {
        let Ok(RecordSummary { files, .. }) = self.finish() else { return };
        if files.messages == 0 {
            files.files.iter().for_each(|path| _ = std::fs::remove_file(path));
        }
    }

    /// Records until `stop` is set or the disk refuses; `tell` is called 20 times a second with what is recorded so far.
    ///
    /// # Errors
    /// [`RecordError::ThreadGone`]; what the disk said comes from [`Recorder::finish`].
    pub fn run(
        &mut self,
        stop: &AtomicBool,
        mut tell: impl FnMut(&RecordSummary),
    ) -> Result<(), RecordError> {
        while !stop.load(Ordering::Relaxed) && !self.writer.has_failed() {
            match self.news.recv_timeout(WAIT) {
                Ok(look) => self.take(look),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(RecordError::ThreadGone(LOOK));
                }
            }
            if self.crew.is_short() {
                return Err(RecordError::ThreadGone(READER));
            }
            let summary = self.queue.summary().clone();
            tell(&summary);
        }
        Ok(())
    }

    /// Takes what is still there, writes what is waiting, closes the file.
    ///
    /// # Errors
    /// What the disk said, now or earlier.
    pub fn finish(self) -> Result<RecordSummary, RecordError> {
        let Self { crew, queue, writer, .. } = self;
        drop(crew);
        let mut summary = queue.summary().clone();
        drop(queue);
        summary.files = writer.join()?;
        Ok(summary)
    }

    fn take(&mut self, look: Look) {
        let trouble = match look {
            Ok(topics) => {
                for topic in topics {
                    self.follow(topic);
                }
                None
            }
            Err(error) => Some(error.to_string()),
        };
        self.queue.summary().set_trouble("topics", trouble);
    }

    /// Begins to record a topic, unless it is a field and nobody asked for fields.
    fn follow(&mut self, topic: Topic) -> Option<Receiver<Opened>> {
        if topic.kind() == TopicKind::Field && !self.options.with_fields {
            return None;
        }
        let (domain, sink) = (self.domain.clone(), self.queue.sink());
        let (sender, opened) = mpsc::channel();
        self.crew.begin(move |stop| lane::keep_moving(&domain, &topic, sink, &sender, stop));
        Some(opened)
    }
}

/// Wall clock minus monotonic clock, taken once: a step of the wall clock while recording moves no message.
fn wall_offset_ns() -> u64 {
    let wall = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(wall.as_nanos()).unwrap_or(u64::MAX).saturating_sub(now_ns())
}

fn about(options: &RecorderOptions, offset_ns: u64) -> BTreeMap<String, String> {
    let keys: Vec<&str> = options.keys.iter().map(KeyExpr::as_str).collect();
    BTreeMap::from([
        ("version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        ("keys".to_owned(), keys.join(" ")),
        // Added to a stamp of the monotonic clock it gives the time since 1970.
        ("wall_minus_monotonic_ns".to_owned(), offset_ns.to_string()),
    ])
}
