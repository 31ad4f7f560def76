//! Records topics: shared memory -> a thread for each topic -> a bounded queue -> one thread that writes -> disk.
//!
//! ```text
//! scan ──topics──> run ──starts──> topic, topic, ... ──messages──> queue ──> writer ──> disk
//! ```
//!
//! Each topic has a thread that receives and encodes (a topic's buffer holds 2 s at 1 kHz), one thread scans for topics, one
//! compresses, writes and syncs. Only the last two wait for a disk, and a topic that is being opened. The queue is bounded in
//! bytes; messages beyond it are dropped and counted, so that a slow disk costs messages and never memory.

mod queue;
mod summary;
#[cfg(test)]
#[path = "../tests/unit/recorder.rs"]
mod tests;
mod topic;

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, Sender};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use wire::layout::LAYOUT_VERSION;
use wire::thread_group::{StopFlag, ThreadEnded, ThreadGroup, WAIT};
use wire::{Bus, Domain, KeyExpr, Topic, TopicKind, WireError, now_ns};

use crate::rotate::{RotateOptions, RotatingWriter};
pub use queue::FLUSH_EVERY;
use queue::{Queue, WriterThread};
pub use summary::{RecordError, RecordSummary};
use topic::Opened;

/// Interval of scans for topics.
const SCAN_EVERY: Duration = Duration::from_millis(250);

/// New topics of a scan, or its error.
type ScanResult = Result<Vec<Topic>, WireError>;

/// Topics and target of a recording.
#[derive(Debug, Clone)]
pub struct RecorderOptions {
    /// Topics, as key expressions.
    pub keys: Vec<KeyExpr>,
    /// Record whole fields too: half a megabyte per sample at full size.
    pub with_fields: bool,
    /// The file; the common beginning of the files' names when rotating.
    pub path: PathBuf,
    /// Rules for new files.
    pub rotate: RotateOptions,
    /// Capacity of the queue, bytes.
    pub queue_bytes: u64,
}

/// A recording in progress.
pub struct Recorder {
    domain: Domain,
    options: RecorderOptions,
    scans: Receiver<ScanResult>,
    // Dropped before the queue: at their end the threads take samples published so far.
    threads: ThreadGroup,
    queue: Queue,
    writer: WriterThread,
}

impl Recorder {
    /// Opens the first file and every topic that exists.
    ///
    /// # Errors
    /// [`RecordError`], also when one of these topics cannot be read. Later errors are in
    /// [`RecordSummary::errors`] and retried. Topics of another version are skipped.
    pub fn start(domain: &Domain, options: RecorderOptions) -> Result<Self, RecordError> {
        let (place, keys) = (domain.clone(), options.keys.clone());
        Self::start_with(domain, options, || {
            let mut bus = None;
            move || {
                let bus = match &mut bus {
                    Some(bus) => bus,
                    none => none.insert(Bus::open(&place)?),
                };
                let found = keys.iter().map(|key| bus.names(key)).collect::<Result<Vec<_>, _>>()?;
                Ok(found.concat())
            }
        })
    }

    /// As [`Self::start`], with another scan. It is made in the thread that runs it.
    fn start_with<F: FnMut() -> ScanResult>(
        domain: &Domain,
        options: RecorderOptions,
        make_scan: impl FnOnce() -> F + Send + 'static,
    ) -> Result<Self, RecordError> {
        let mut file = RotatingWriter::create(&options.path, options.rotate)?;
        let offset_ns = wall_offset_ns();
        file.metadata(crate::ABOUT, &about(&options, offset_ns))?;
        file.flush()?;
        let (queue, writer) = queue::start(file, options.queue_bytes, offset_ns)?;
        let (sender, scans) = mpsc::channel();
        let threads = ThreadGroup::default();
        let mut recorder = Self { domain: domain.clone(), options, scans, threads, queue, writer };
        let started = recorder.threads.start("topic scan", move |stop| {
            keep_scanning(make_scan(), &sender, stop);
            Ok(())
        });
        match started.map_err(RecordError::Start).and_then(|()| recorder.open_topics()) {
            Ok(()) => Ok(recorder),
            Err(error) => {
                recorder.remove_empty_file();
                Err(error)
            }
        }
    }

    /// Waits until all topics of the first scan are open. One that is just being created or removed, or that a program of
    /// another version made, is not waited for.
    fn open_topics(&mut self) -> Result<(), RecordError> {
        let topics = receive(&mut self.threads, &self.scans)??;
        let tries = topics.into_iter().map(|topic| self.follow(topic)).collect::<Result<Vec<_>, _>>()?;
        for opened in tries.into_iter().flatten() {
            match receive(&mut self.threads, &opened)? {
                Ok(()) | Err(WireError::InFlux { .. } | WireError::Incompatible { .. }) => {}
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }

    /// Ends the recording and removes its file if it holds nothing: the next start would refuse to overwrite it.
    fn remove_empty_file(self) {
        let Ok(RecordSummary { files, .. }) = self.finish() else { return };
        if files.messages == 0 {
            files.files.iter().for_each(|path| _ = std::fs::remove_file(path));
        }
    }

    /// Records until `stop` is set or a write fails; calls `report` 20 times per second with the summary so far.
    ///
    /// # Errors
    /// [`RecordError::Thread`]; the error of the disk comes from [`Recorder::finish`].
    pub fn run(
        &mut self,
        stop: &AtomicBool,
        mut report: impl FnMut(&Self, &RecordSummary),
    ) -> Result<(), RecordError> {
        while !stop.load(Ordering::Relaxed) && !self.writer.has_ended() {
            if let Ok(result) = self.scans.recv_timeout(WAIT) {
                self.follow_new(result)?;
            }
            self.threads.check()?;
            let summary = self.queue.summary().clone();
            report(self, &summary);
        }
        Ok(())
    }

    /// Ends the current file and begins the next one when the recording rotates; writes everything out in any case.
    pub fn begin_new_file(&self) {
        self.queue.begin_new_file();
    }

    /// Records samples published so far, writes the queue, closes the file.
    ///
    /// # Errors
    /// The disk's, now or earlier.
    pub fn finish(self) -> Result<RecordSummary, RecordError> {
        let Self { threads, queue, writer, .. } = self;
        drop(threads);
        let mut summary = queue.summary().clone();
        drop(queue);
        summary.files = writer.join()?;
        Ok(summary)
    }

    fn follow_new(&mut self, result: ScanResult) -> Result<(), RecordError> {
        self.queue.summary().set_error("topics", result.as_ref().err());
        for topic in result.unwrap_or_default() {
            self.follow(topic)?;
        }
        Ok(())
    }

    /// Starts to record a topic; a field only if fields are asked for.
    fn follow(&mut self, topic: Topic) -> Result<Option<Receiver<Opened>>, RecordError> {
        if topic.kind() == TopicKind::Field && !self.options.with_fields {
            return Ok(None);
        }
        let (sender, opened) = mpsc::channel();
        let name = topic.name().to_owned();
        let (domain, sink) = (self.domain.clone(), self.queue.sink(topic));
        let started = self.threads.start(&name, move |stop| {
            topic::keep_moving(&domain, sink, &sender, stop);
            Ok(())
        });
        started.map(|()| Some(opened)).map_err(RecordError::Start)
    }
}

/// Scans repeatedly and sends new topics, until `stop` is set. Listing topics can block for seconds on a busy disk, so this is a
/// separate thread.
fn keep_scanning(mut scan: impl FnMut() -> ScanResult, found: &Sender<ScanResult>, stop: &StopFlag) {
    let mut seen = BTreeSet::new();
    while !stop.is_set() {
        let result = scan().map(|mut topics| {
            topics.retain(|topic| seen.insert(topic.name().to_owned()));
            topics
        });
        // Without a receiver the stop flag is about to be set.
        let _ = found.send(result);
        stop.pause(SCAN_EVERY);
    }
}

/// Waits for what a thread of the group sends.
fn receive<T>(threads: &mut ThreadGroup, from: &Receiver<T>) -> Result<T, ThreadEnded> {
    loop {
        match from.recv_timeout(WAIT) {
            Ok(value) => return Ok(value),
            Err(_) => threads.check()?,
        }
    }
}

/// Wall clock minus monotonic clock, ns, to be taken once: a step of the wall clock later moves no message.
pub fn wall_offset_ns() -> u64 {
    let wall = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(wall.as_nanos()).unwrap_or(u64::MAX).saturating_sub(now_ns())
}

fn about(options: &RecorderOptions, offset_ns: u64) -> BTreeMap<String, String> {
    let keys: Vec<&str> = options.keys.iter().map(KeyExpr::as_str).collect();
    BTreeMap::from([
        ("version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        (crate::LAYOUT.to_owned(), LAYOUT_VERSION.to_string()),
        ("keys".to_owned(), keys.join(" ")),
        // Added to a stamp of the monotonic clock it gives the time since 1970.
        (crate::clock::OFFSET.to_owned(), offset_ns.to_string()),
        (crate::clock::BOOT.to_owned(), crate::clock::boot_id()),
    ])
}
