//! Records topics: shared memory -> a thread for each topic -> a bounded queue -> one thread that writes -> disk.
//!
//! ```text
//! scan ──topics──> run ──starts──> topic, topic, ... ──messages──> queue ──> writer ──> disk
//! ```
//!
//! Each topic has a thread that receives and encodes (a topic's buffer holds 2 s at 1 kHz), one thread scans for topics, one
//! compresses, writes and syncs. Only the last two wait for a disk, and a topic that is being opened. The queue is bounded in
//! bytes; messages beyond it are dropped and counted, so that a slow disk costs messages and never memory.

use crate::message;
use crate::message::{EncodeJson, FieldMessage, GapCounter, GapMessage, GapObservation};
use crate::rotate::{DiskUse, RotateOptions, RotateSummary, RotatingWriter};
use crate::writer::{Channel, WriteError};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, mpsc};
use std::thread;
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use thiserror::Error;
use wire::layout::{LAYOUT_VERSION, Layout, Payload, hex};
use wire::thread_group::{StopFlag, ThreadEnded, ThreadGroup, WAIT, panic_cause};
use wire::{
    AnyReader, AnySample, Bus, Command, Domain, Estimate, FieldHeader, Grasp, Health, KeyExpr, SensorSample,
    Setpoint, Stamp, State, Target, Topic, TopicKind, Valve, WakeSet, Wakeable, Waking, WireError, now_ns,
};

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
        let (queue, writer) = start(file, options.queue_bytes, offset_ns)?;
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
            keep_moving(&domain, sink, &sender, stop);
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

// ---- the bounded queue between the topics and the disk, and the thread that writes ----

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
        let GapObservation { gap, missing } = self.gaps.observe(stamp);
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

// ---- one topic's samples ----

// Moves the samples of one topic to the queue, on a dedicated thread: opening a topic writes to the folder of the shared-memory
// domain, and a busy disk must not delay the other topics.

/// Pause before a topic that cannot be read is tried again.
const RETRY: Duration = Duration::from_secs(1);

/// Whether a topic could be opened.
pub type Opened = Result<(), WireError>;

/// Moves everything of a topic into `sink`, and opens it again when it breaks. The result of each try goes to `opened`.
pub fn keep_moving(domain: &Domain, mut sink: QueueSink, opened: &Sender<Opened>, stop: &StopFlag) {
    while !stop.is_set() {
        if let Err(error) = open_and_move(domain, &mut sink, opened, stop) {
            sink.set_error(Some(&error));
            report(opened, Err(error));
            stop.pause(RETRY);
        }
    }
}

/// Returns when `stop` is set, or when the topic cannot be opened or breaks.
fn open_and_move(
    domain: &Domain,
    sink: &mut QueueSink,
    opened: &Sender<Opened>,
    stop: &StopFlag,
) -> Result<(), WireError> {
    let bus = Bus::open(domain)?;
    let reader = AnyReader::attach_as(&bus, sink.topic(), Waking::ByEvent)?;
    sink.set_error(None);
    report(opened, Ok(()));
    let mut wakes = WakeSet::new([&reader as &dyn Wakeable]);
    while !stop.is_set() {
        wakes.wait(WAIT)?;
        while let Some(sample) = reader.next()? {
            sink.put(&sample);
            // A topic that is faster than this thread never runs empty.
            if stop.is_set() {
                break;
            }
        }
    }
    drain_published_before(now_ns(), &reader, sink)
}

fn drain_published_before(end_ns: u64, reader: &AnyReader, sink: &mut QueueSink) -> Result<(), WireError> {
    while let Some(sample) = reader.next()? {
        sink.put(&sample);
        if sample.stamp().t_publish_ns > end_ns {
            break;
        }
    }
    Ok(())
}

/// Only the first try has a receiver; the others are seen in the summary.
fn report(opened: &Sender<Opened>, result: Opened) {
    let _ = opened.send(result);
}

// ---- summary and errors of a recording ----

/// Error that ended a recording.
#[derive(Debug, Error)]
pub enum RecordError {
    /// The shared memory.
    #[error(transparent)]
    Wire(#[from] WireError),
    /// The disk.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// A thread of the recorder is gone.
    #[error(transparent)]
    Thread(#[from] ThreadEnded),
    /// A thread could not be started.
    #[error("cannot start a thread of the recorder: {0}; check the limits of the system (ulimit -u)")]
    Start(std::io::Error),
}

/// Summary of a recording.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RecordSummary {
    pub messages: BTreeMap<String, u64>,
    /// Samples that were published and never reached the recorder, by jumps in the sequence numbers.
    pub missing: u64,
    /// Messages that were received and dropped because the disk was too slow.
    pub dropped: u64,
    /// Current errors by topic, or `topics` if they cannot be listed; retried.
    pub errors: BTreeMap<String, String>,
    /// Topics of another version, with the difference; they are not recorded.
    pub skipped: BTreeMap<String, String>,
    /// Disk use of the series at the last flush.
    pub disk: DiskUse,
    /// Number of flushes; constant while the disk is blocked.
    pub flushes: u64,
    /// The files; empty until the end.
    pub files: RotateSummary,
}

impl RecordSummary {
    /// Counts a message that was queued, or dropped because the queue was full.
    pub(super) fn count(&mut self, topic: &str, is_queued: bool) {
        match self.messages.get_mut(topic) {
            _ if !is_queued => self.dropped += 1,
            Some(count) => *count += 1,
            None => _ = self.messages.insert(topic.to_owned(), 1),
        }
    }

    /// Counts a flush and stores the disk use.
    pub(super) fn flushed(&mut self, disk: DiskUse) {
        self.disk = disk;
        self.flushes += 1;
    }

    /// Counts samples that never arrived; of one that came late -1.
    pub(super) fn add_missing(&mut self, samples: i64) {
        self.missing = self.missing.saturating_add_signed(samples);
    }

    /// Sets or clears the error of `what`.
    pub(super) fn set_error(&mut self, what: &str, cause: Option<&WireError>) {
        self.errors.remove(what);
        self.skipped.remove(what);
        if let Some(cause) = cause {
            let is_foreign = matches!(cause, WireError::Incompatible { .. });
            let notes = if is_foreign { &mut self.skipped } else { &mut self.errors };
            notes.insert(what.to_owned(), cause.to_string());
        }
    }
}

#[cfg(test)]
#[path = "../tests/unit/recorder.rs"]
mod tests;
