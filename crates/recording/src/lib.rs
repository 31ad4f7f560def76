//! Recordings: MCAP files that survive a crash on the writing side and anything at all on the reading side.
//!
//! A recording holds sensor readings, states, health and, when asked, whole fields, as JSON messages with JSON schemas
//! ([`message`]), so that any viewer that reads MCAP shows them.
//!
//! The container is the `mcap` crate's. Added here is what a service needs beside it:
//! * **crash safety**: a chunk goes to the file in one piece, and each is preceded by its channels, so a file is readable up
//!   to its last whole chunk after `kill -9`, and around a damaged chunk;
//! * **a full disk**: the oldest files of the series make room where that is allowed; otherwise a failed write is cut off again, so
//!   the file still ends at a whole chunk;
//! * **hostile input**: the reader's memory is bounded by [`MAX_RECORD_BYTES`] and it never panics.
#![forbid(unsafe_code)]

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
pub mod thread_group;
mod writer;

pub use contents::{ChannelInfo, Item, Message};
pub use csv::{ExportError, Exported, TableForm, export_csv};
pub use message::{Gap, GapCounter};
pub use reader::{Ending, MAX_RECORD_BYTES, ReadError, Reader};
pub use recorder::{FLUSH_EVERY, RecordError, RecordSummary, Recorder, RecorderOptions, wall_offset_ns};
pub use retention::{FreeSpace, Retention};
pub use rotate::{DiskUse, RotateOptions, RotateSummary, RotatingWriter};
pub use series::{ReadItems, Series, SeriesReader};
pub use store::Store;
pub use thread_group::{StopFlag, ThreadEnded, ThreadGroup, ThreadResult};
pub use writer::{Channel, ChannelId, WriteError, Writer};

/// Metadata at the head of every file.
const ABOUT: &str = "softtwin.recording";
/// Key of the payloads' layout in it.
const LAYOUT: &str = "layout";

/// First and last eight bytes of every MCAP file.
pub const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";
