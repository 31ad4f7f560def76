//! Recordings: MCAP files that survive a crash on the writing side and anything at all on the reading side.
//!
//! A recording holds sensor readings, states, health and, when asked, whole fields, as JSON messages with JSON schemas
//! ([`message`]), so that any viewer that reads MCAP shows them.
//!
//! The container is written here rather than by a library for three reasons that matter to a service:
//! * **crash safety**: a chunk goes to disk in one piece, never patched afterwards, so whatever a `kill -9` leaves behind
//!   is readable up to the last closed chunk;
//! * **a full disk**: a failed write is cut off again, so the file still ends at a whole chunk;
//! * **hostile input**: the reader's memory is bounded by [`MAX_RECORD_BYTES`] and it never panics.
//!
//! The tests read our files with the format's reference implementation, and its files with our reader.
#![forbid(unsafe_code)]

mod chunk;
mod csv;
mod encode;
mod gaps;
pub mod message;
mod parse;
mod reader;
mod recorder;
mod rotate;
mod store;
mod summary;
mod writer;

pub use csv::{ExportError, Exported, export_csv};
pub use gaps::{Gap, GapCounter};
pub use reader::{Ending, Item, Message, ReadError, Reader};
pub use recorder::{FLUSH_EVERY, Outlet, Port, RecordError, RecordSummary, Recorder, RecorderOptions, Stamp};
pub use rotate::{RotateOptions, RotateSummary, RotatingWriter};
pub use store::Store;
pub use writer::{Channel, ChannelId, WriteError, WriteSummary, Writer};

use std::sync::Arc;

/// Largest record, and largest decompressed chunk, that a reader takes into memory: 64 MiB.
///
/// A field of 125,110 values is half a megabyte, so a chunk of ours stays far below.
pub const MAX_RECORD_BYTES: u64 = 64 << 20;

/// First and last eight bytes of every MCAP file.
pub const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";

/// What the reader knows of a message's channel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChannelInfo {
    /// Topic, such as `softtwin/finger/state`.
    pub topic: String,
    /// `json` for everything this project writes.
    pub message_encoding: String,
    /// Name of the schema; empty when the channel has none.
    pub schema_name: String,
}

/// A channel shared by its messages.
pub type SharedChannel = Arc<ChannelInfo>;

/// Record kinds of the format that are written or understood here.
mod op {
    pub const HEADER: u8 = 0x01;
    pub const FOOTER: u8 = 0x02;
    pub const SCHEMA: u8 = 0x03;
    pub const CHANNEL: u8 = 0x04;
    pub const MESSAGE: u8 = 0x05;
    pub const CHUNK: u8 = 0x06;
    pub const MESSAGE_INDEX: u8 = 0x07;
    pub const CHUNK_INDEX: u8 = 0x08;
    pub const STATISTICS: u8 = 0x0B;
    pub const METADATA: u8 = 0x0C;
    pub const METADATA_INDEX: u8 = 0x0D;
    pub const SUMMARY_OFFSET: u8 = 0x0E;
    pub const DATA_END: u8 = 0x0F;
}
