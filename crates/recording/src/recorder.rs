//! Takes everything off the wire and hands it to a writer that may wait for the disk.
//!
//! Two threads: the caller's drains the ports (their queues hold 64 readings, so it never waits for anything), the
//! writer's compresses, writes and syncs. Between them lies a queue bounded in bytes; what does not fit is dropped and
//! counted, so that a slow disk costs messages and never memory.

mod drain;
mod queue;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use thiserror::Error;
use wire::{Bus, KeyExpr, WakeSet, Waking, WireError, now_ns};

use crate::{RotateOptions, RotateSummary, RotatingWriter, WriteError};
pub use drain::{Outlet, Port, Stamp};
use queue::{Sink, WriterThread};

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
/// How often new topics are looked for.
const DISCOVER_EVERY: Duration = Duration::from_millis(250);
/// Longest sleep, so that the stop flag is seen.
const WAIT: Duration = Duration::from_millis(50);

/// Why recording ended early.
#[derive(Debug, Error)]
pub enum RecordError {
    /// The shared memory.
    #[error(transparent)]
    Wire(#[from] WireError),
    /// The disk.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// The writer's thread is gone without an error of its own.
    #[error("the recorder's writer stopped without a word; this is a defect, please report it")]
    WriterGone,
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
    /// The files.
    pub files: RotateSummary,
}

/// A recording in progress. Lives in the thread that made it.
pub struct Recorder {
    bus: Bus,
    options: RecorderOptions,
    ports: Vec<Port>,
    sink: Sink,
    writer: WriterThread,
    next_discovery: Instant,
}

impl Recorder {
    /// Opens the first file and attaches to what is there already.
    ///
    /// # Errors
    /// [`RecordError`].
    pub fn start(bus: &Bus, options: RecorderOptions) -> Result<Self, RecordError> {
        let mut file = RotatingWriter::create(&options.path, options.rotate)?;
        let offset_ns = wall_offset_ns();
        file.metadata("softtwin.recording", &about(&options, offset_ns))?;
        file.flush()?;
        let (sink, writer) = queue::start(file, options.queue_bytes, offset_ns);
        let next_discovery = Instant::now();
        let mut recorder =
            Self { bus: bus.clone(), options, ports: Vec::new(), sink, writer, next_discovery };
        recorder.discover()?;
        Ok(recorder)
    }

    /// Records until `stop` is set or the disk refuses; `tell` is called after every turn with what is recorded so far.
    ///
    /// # Errors
    /// [`RecordError::Wire`]; what the disk said comes from [`Recorder::finish`].
    pub fn run(
        &mut self,
        stop: &AtomicBool,
        mut tell: impl FnMut(&RecordSummary),
    ) -> Result<(), RecordError> {
        let mut wakes = self.wake_set();
        while !stop.load(Ordering::Relaxed) && !self.writer.has_failed() {
            if self.next_discovery <= Instant::now() && self.discover()? {
                wakes = self.wake_set();
            }
            wakes.wait(self.ports.iter().map(Port::wakeable), WAIT)?;
            self.drain()?;
            tell(self.sink.summary());
        }
        self.drain()
    }

    /// Writes what is waiting, closes the file.
    ///
    /// # Errors
    /// What the disk said, now or earlier.
    pub fn finish(self) -> Result<RecordSummary, RecordError> {
        let Self { sink, writer, .. } = self;
        let mut summary = sink.into_summary();
        summary.files = writer.join()?;
        Ok(summary)
    }

    fn wake_set(&self) -> WakeSet {
        WakeSet::new(self.ports.iter().map(Port::wakeable))
    }

    fn drain(&mut self) -> Result<(), RecordError> {
        for port in &self.ports {
            port.drain(&mut self.sink)?;
        }
        Ok(())
    }

    /// Attaches to topics that are new; true when there were any.
    fn discover(&mut self) -> Result<bool, RecordError> {
        self.next_discovery = Instant::now() + DISCOVER_EVERY;
        let before = self.ports.len();
        for key in &self.options.keys {
            for info in self.bus.topics(key)? {
                let is_known = self.ports.iter().any(|port| port.topic() == &info.topic);
                let (topic, with_fields) = (&info.topic, self.options.with_fields);
                if !is_known && let Some(port) = Port::open(&self.bus, topic, with_fields, Waking::ByEvent)? {
                    self.ports.push(port);
                }
            }
        }
        Ok(self.ports.len() > before)
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

/// Shared between the two threads.
type Flag = Arc<AtomicBool>;
