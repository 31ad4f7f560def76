//! Writes one MCAP file, chunk by chunk.
//!
//! The `mcap` crate encodes into memory ([`Staging`]); each closed chunk goes to the file in one piece and is never changed
//! afterwards. A program that is killed leaves a file that is readable up to its last whole chunk.

use std::collections::BTreeMap;
use std::io::{self, Cursor};
use std::path::PathBuf;

use mcap::records::{MessageHeader, Metadata};
use mcap::{Compression, McapError, McapResult, WriteOptions};
use thiserror::Error;

use crate::store::{Staging, Store};

/// A chunk is closed at this size at the latest.
const CHUNK_BYTES: usize = 1 << 20;

/// Topic and schema of messages.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Channel {
    /// Topic, such as `softtwin/finger/state`.
    pub topic: String,
    /// Name of the schema, such as `softtwin.State`.
    pub schema_name: String,
    /// JSON schema of the messages.
    pub schema: String,
}

/// A channel of one writer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct ChannelId(u16);

/// Error that ends a file.
#[derive(Debug, Error)]
pub enum WriteError {
    /// The disk refused. The file was cut back to its last whole chunk and stays readable.
    #[error(
        "recording stopped: {source}; the file is readable up to its last whole chunk ({kept_messages} messages kept, \
         {lost_messages} not written). Free space, or record with --keep, --keep-mb or --free-mb, then start again"
    )]
    Store { source: io::Error, kept_messages: u64, lost_messages: u64 },
    /// The first file exists already.
    #[error("{} is there already, and a recording never overwrites: name another file, or remove it", path.display())]
    Exists { path: PathBuf },
    /// The first file cannot be created.
    #[error("cannot make {}: {cause}; its folder must exist, be writable and have room", path.display())]
    Create { path: PathBuf, cause: io::Error },
    /// The file was removed.
    #[error("{} was deleted while it was being recorded; what it held is lost. Start again with another file", path.display())]
    Deleted { path: PathBuf },
    /// An earlier write failed; the file accepts no more messages.
    #[error("the recording already ended with a failed write; open a new file")]
    Ended,
    /// The container refused, such as more than 65535 channels in a file.
    #[error("recording stopped: {0}; record fewer topics, or into several files")]
    Container(#[from] McapError),
}

/// Writes one recording. A message is on disk after the next [`Writer::flush`]; call it at least once a second.
///
/// Memory: one open chunk of about 1 MiB, and about 300 bytes for each closed chunk until the file is finished.
pub struct Writer<S: Store> {
    store: S,
    staging: Staging,
    mcap: mcap::Writer<Staging>,
    channels: Vec<(Channel, ChannelId)>,
    messages: u64,
    chunk_messages: u64,
    /// Bytes in the open chunk, before compression; 0: no chunk is open.
    chunk_bytes: usize,
    ended: bool,
}

impl<S: Store> Writer<S> {
    /// Starts a file in an empty store.
    ///
    /// # Errors
    /// [`WriteError::Store`] when the head of the file cannot be written.
    pub fn new(store: S) -> Result<Self, WriteError> {
        let staging = Staging::default();
        let mcap = options().disable_seeking(true).create(staging.clone())?;
        let mut writer = Self {
            store,
            staging,
            mcap,
            channels: Vec::new(),
            messages: 0,
            chunk_messages: 0,
            chunk_bytes: 0,
            ended: false,
        };
        writer.write_staged()?;
        Ok(writer)
    }

    pub fn store(&self) -> &S {
        &self.store
    }

    /// Bytes in the file and in the open chunk (before compression).
    pub fn bytes(&self) -> u64 {
        self.staging.lock().file_bytes + self.chunk_bytes as u64
    }

    /// The channel of this description; added at its first mention.
    ///
    /// # Errors
    /// [`WriteError::Container`] when there are too many.
    pub fn channel(&mut self, channel: &Channel) -> Result<ChannelId, WriteError> {
        if let Some((_, id)) = self.channels.iter().find(|(known, _)| known == channel) {
            return Ok(*id);
        }
        self.open_chunk()?;
        let id = ChannelId(add_channel(&mut self.mcap, channel)?);
        self.chunk_bytes += channel.schema.len();
        self.channels.push((channel.clone(), id));
        Ok(id)
    }

    /// Adds one message. `log_time_ns` is when it was recorded, `publish_time_ns` when it was sent, both since 1970.
    ///
    /// # Errors
    /// [`WriteError`] when this message filled a chunk that could not be written.
    pub fn message(
        &mut self,
        channel: ChannelId,
        sequence: u32,
        log_time_ns: u64,
        publish_time_ns: u64,
        data: &[u8],
    ) -> Result<(), WriteError> {
        self.open_chunk()?;
        let header = MessageHeader {
            channel_id: channel.0,
            sequence,
            log_time: log_time_ns,
            publish_time: publish_time_ns,
        };
        self.mcap.write_to_known_channel(&header, data)?;
        self.chunk_bytes += size_of::<MessageHeader>() + data.len();
        self.chunk_messages += 1;
        self.messages += 1;
        if self.chunk_bytes >= CHUNK_BYTES { self.close_chunk() } else { Ok(()) }
    }

    /// Adds a named table of strings (model hash, versions) and writes it at once.
    pub fn metadata(&mut self, name: &str, entries: &BTreeMap<String, String>) -> Result<(), WriteError> {
        self.close_chunk()?;
        self.mcap.write_metadata(&Metadata { name: name.to_owned(), metadata: entries.clone() })?;
        self.write_staged()
    }

    /// Closes the open chunk and forces everything onto the medium: what was written before this survives a crash.
    pub fn flush(&mut self) -> Result<(), WriteError> {
        self.close_chunk()?;
        self.store.sync().map_err(|source| self.fail(source))
    }

    /// Closes the file with its summary and returns the store. A writer that is dropped instead leaves a file without a
    /// footer, which can be read as well.
    ///
    /// # Errors
    /// [`WriteError`]; all messages but those of the open chunk are in the file even then.
    pub fn finish(mut self) -> Result<S, WriteError> {
        self.close_chunk()?;
        self.mcap.finish()?;
        self.write_staged()?;
        self.store.sync().map_err(|source| self.fail(source))?;
        Ok(self.store)
    }

    /// Begins a chunk unless one is open. All channels so far precede it in a separate chunk: the crate writes each
    /// channel once, and a damaged chunk would take all messages of its channels with it
    /// (test `a_damaged_chunk_is_left_out_alone`).
    fn open_chunk(&mut self) -> Result<(), WriteError> {
        if self.ended {
            return Err(WriteError::Ended);
        }
        if self.chunk_bytes == 0 && !self.channels.is_empty() {
            let channels = channel_chunk(&self.channels)?;
            self.staging.lock().bytes.extend(channels);
        }
        self.chunk_bytes = self.chunk_bytes.max(1);
        Ok(())
    }

    fn close_chunk(&mut self) -> Result<(), WriteError> {
        if self.ended {
            return Err(WriteError::Ended);
        }
        self.mcap.flush()?;
        self.chunk_bytes = 0;
        self.write_staged()?;
        self.chunk_messages = 0;
        Ok(())
    }

    fn write_staged(&mut self) -> Result<(), WriteError> {
        let mut staged = self.staging.lock();
        let written = self.store.write_all(&staged.bytes);
        if written.is_ok() {
            staged.file_bytes += staged.bytes.len() as u64;
        }
        staged.bytes.clear();
        drop(staged);
        written.map_err(|source| self.fail(source))
    }

    /// Cuts off an incomplete write. If that fails too, readers stop at the last whole chunk.
    fn fail(&mut self, source: io::Error) -> WriteError {
        self.ended = true;
        let file_bytes = self.staging.lock().file_bytes;
        let source = match self.store.cut_to(file_bytes) {
            Ok(()) => source,
            Err(cut) => {
                io::Error::new(source.kind(), format!("{source}; cutting the file back failed too: {cut}"))
            }
        };
        let lost_messages = self.chunk_messages;
        WriteError::Store { source, kept_messages: self.messages - lost_messages, lost_messages }
    }
}

/// Chunks are closed by [`Writer`] alone. The data section has no checksum, because the crate does not know the
/// repeated channels; each chunk has one.
fn options() -> WriteOptions {
    WriteOptions::new()
        .library(concat!("softtwin ", env!("CARGO_PKG_VERSION")))
        .compression(Some(Compression::Lz4))
        .chunk_size(None)
        .calculate_data_section_crc(false)
}

fn add_channel<W: io::Write + io::Seek>(mcap: &mut mcap::Writer<W>, channel: &Channel) -> McapResult<u16> {
    let schema = mcap.add_schema(&channel.schema_name, "jsonschema", channel.schema.as_bytes())?;
    mcap.add_channel(schema, &channel.topic, "json", &BTreeMap::new())
}

/// A chunk that holds these channels and no message. Added in the same order to an empty file, they get the same numbers.
fn channel_chunk(channels: &[(Channel, ChannelId)]) -> McapResult<Vec<u8>> {
    let mut mcap = options().create(Cursor::new(Vec::new()))?;
    for (channel, _) in channels {
        add_channel(&mut mcap, channel)?;
    }
    let summary = mcap.finish()?;
    let mut bytes = mcap.into_inner().into_inner();
    let Some(chunk) = summary.chunk_indexes.first() else { return Ok(Vec::new()) };
    bytes.truncate((chunk.chunk_start_offset + chunk.chunk_length) as usize);
    Ok(bytes.split_off(chunk.chunk_start_offset as usize))
}
