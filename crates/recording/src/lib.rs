//! Recordings: MCAP files that are readable after a crash of the writer, and a reader for files in any state.
//!
//! A recording holds sensor readings, states, health and, when asked, whole fields, as JSON messages with JSON schemas
//! ([`message`]), so that any viewer that reads MCAP shows them.
//!
//! The container is that of the `mcap` crate. This crate adds for services:
//! * **crash safety**: a chunk is written in one piece, after its channels, so a file is readable up to its last whole chunk
//!   after `kill -9`, and around a damaged chunk;
//! * **a full disk**: the oldest files of the series are removed if allowed; otherwise a failed write is cut off, so the file
//!   ends at a whole chunk;
//! * **hostile input**: the reader's memory is bounded by [`MAX_RECORD_BYTES`] and it never panics.
#![forbid(unsafe_code)]

mod chunk;
mod clock;
mod contents;
mod csv;
pub mod message;
mod parse;
mod reader;
mod recorder;
mod retention;
mod rotate;
mod series;
mod store;
mod tracks;
mod writer;

pub use chunk::MAX_RECORD_BYTES;
pub use clock::{RunClock, Stamps};
pub use contents::{ChannelInfo, Item, Message};
pub use csv::{ExportError, Exported, TableForm, export_csv};
pub use message::{GapCounter, GapObservation, SequenceGap};
pub use reader::{Ending, ReadError, RecordingReader};
pub use recorder::{FLUSH_EVERY, RecordError, RecordSummary, Recorder, RecorderOptions, wall_offset_ns};
pub use retention::{FreeSpace, Retention};
pub use rotate::{DiskUse, RotateOptions, RotateSummary, RotatingWriter};
pub use series::{ReadItems, RecordingFiles, SeriesReader};
pub use store::Store;
pub use tracks::{Messages, RecordedField, RecordedState, RecordingData, Thinned, Track};
pub use writer::{Channel, ChannelId, WriteError, Writer};

/// Metadata at the head of every file.
const ABOUT: &str = "softtwin.recording";
/// Key of the payloads' layout in it.
const LAYOUT: &str = "layout";

/// First and last eight bytes of every MCAP file.
pub const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";
