//! Writes one MCAP file, chunk by chunk.

use std::collections::BTreeMap;
use std::io;
use std::path::PathBuf;

use thiserror::Error;

use crate::chunk::{Chunk, ChunkPlace};
use crate::store::Store;
use crate::summary::{MetadataPlace, Summary};
use crate::{MAGIC, encode, op};

/// A chunk is closed at this size at the latest.
const CHUNK_BYTES: usize = 1 << 20;

/// What a channel says about itself.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Channel {
    /// Topic, such as `softtwin/finger/state`.
    pub topic: String,
    /// Name of the schema, such as `softtwin.State`.
    pub schema_name: String,
    /// JSON schema of the messages.
    pub schema_json: String,
}

/// A channel of one writer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct ChannelId(pub(crate) u16);

/// Why a recording could not go on.
#[derive(Debug, Error)]
pub enum WriteError {
    /// The medium refused. The file was cut back to its last whole chunk and stays readable.
    #[error(
        "recording stopped: {source}; the file is readable up to its last whole chunk ({kept_messages} messages kept, \
         {lost_messages} not written). Free space, or record with --keep, then start again"
    )]
    Store {
        /// What the system said.
        source: io::Error,
        /// Messages safely in the file.
        kept_messages: u64,
        /// Messages that were in the chunk that could not be written.
        lost_messages: u64,
    },
    /// The first file is somebody's already.
    #[error("{} is there already, and a recording never overwrites: name another file, or remove it", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// The first file cannot be made.
    #[error("cannot make {}: {cause}; its folder must exist, be writable and have room", path.display())]
    Create {
        /// The file.
        path: PathBuf,
        /// What the system said.
        cause: io::Error,
    },
    /// An earlier write failed; nothing more is written to this file.
    #[error("the recording already ended with a failed write; open a new file")]
    Ended,
    /// More channels than the format can number.
    #[error("expected at most 65535 channels in a recording; topic {topic} is one more")]
    TooManyChannels {
        /// The topic that did not fit.
        topic: String,
    },
}

/// What a finished file holds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct WriteSummary {
    /// Messages in the file.
    pub messages: u64,
    /// Chunks in the file.
    pub chunks: u64,
    /// Bytes of the file.
    pub bytes: u64,
}

/// Writes one recording. A message is on disk after the next [`Writer::flush`]; call it at least once a second.
///
/// Memory: one open chunk of about 1 MiB, and about 150 bytes for each closed chunk until the file is finished.
pub struct Writer<S: Store> {
    store: S,
    len: u64,
    chunk: Chunk,
    channels: Vec<Channel>,
    announced: usize,
    summary: Summary,
    ended: bool,
}

impl<S: Store> Writer<S> {
    /// Starts a file in an empty store.
    ///
    /// # Errors
    /// [`WriteError::Store`] when the head of the file cannot be written.
    pub fn new(store: S) -> Result<Self, WriteError> {
        let mut head = MAGIC.to_vec();
        encode::record(&mut head, op::HEADER, |out| {
            encode::string(out, "");
            encode::string(out, concat!("softtwin ", env!("CARGO_PKG_VERSION")));
        });
        let mut writer = Self {
            store,
            len: 0,
            chunk: Chunk::default(),
            channels: Vec::new(),
            announced: 0,
            summary: Summary::default(),
            ended: false,
        };
        writer.append(&head, 0)?;
        Ok(writer)
    }

    /// Bytes in the file and in the open chunk (before compression).
    pub fn bytes(&self) -> u64 {
        self.len + self.chunk.len() as u64
    }

    /// The channel of this description; made at its first mention.
    ///
    /// # Errors
    /// [`WriteError::TooManyChannels`].
    pub fn channel(&mut self, channel: &Channel) -> Result<ChannelId, WriteError> {
        if let Some(at) = self.channels.iter().position(|known| known == channel) {
            return Ok(ChannelId(at as u16 + 1));
        }
        if self.channels.len() >= usize::from(u16::MAX) {
            return Err(WriteError::TooManyChannels { topic: channel.topic.clone() });
        }
        self.channels.push(channel.clone());
        Ok(ChannelId(self.channels.len() as u16))
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
        if self.ended {
            return Err(WriteError::Ended);
        }
        self.announce();
        self.chunk.push(channel.0, sequence, log_time_ns, publish_time_ns, data);
        self.summary.count(channel.0, log_time_ns);
        if self.chunk.len() >= CHUNK_BYTES { self.close_chunk() } else { Ok(()) }
    }

    /// Adds a named table of texts (model hash, versions), on disk at once.
    ///
    /// # Errors
    /// [`WriteError`].
    pub fn metadata(&mut self, name: &str, entries: &BTreeMap<String, String>) -> Result<(), WriteError> {
        self.close_chunk()?;
        let mut out = Vec::new();
        encode::record(&mut out, op::METADATA, |out| {
            encode::string(out, name);
            encode::string_map(out, entries);
        });
        let place = MetadataPlace { offset: self.len, length: out.len() as u64, name: name.to_owned() };
        self.append(&out, 0)?;
        self.summary.metadata.push(place);
        Ok(())
    }

    /// Closes the open chunk and forces everything onto the medium: what was written before this survives a crash.
    ///
    /// # Errors
    /// [`WriteError`].
    pub fn flush(&mut self) -> Result<(), WriteError> {
        self.close_chunk()?;
        self.store.sync().map_err(|source| self.fail(source, 0))
    }

    /// Closes the file with its summary. Dropping the writer instead leaves a file without a footer, which reads as well.
    ///
    /// # Errors
    /// [`WriteError`]; all messages but those of the open chunk are in the file even then.
    pub fn finish(mut self) -> Result<(WriteSummary, S), WriteError> {
        self.close_chunk()?;
        let tail = self.summary.encode(self.len, &self.channels);
        self.append(&tail, 0)?;
        self.store.sync().map_err(|source| self.fail(source, 0))?;
        let done = WriteSummary {
            messages: self.summary.messages(),
            chunks: self.summary.chunks.len() as u64,
            bytes: self.len,
        };
        Ok((done, self.store))
    }

    /// Puts the channels in front of the first message that needs them, in every chunk anew: a chunk stands alone, so a
    /// damaged one takes no other with it.
    fn announce(&mut self) {
        if self.chunk.is_empty() {
            self.announced = 0;
        }
        for (at, channel) in self.channels.iter().enumerate().skip(self.announced) {
            channel.encode(at as u16 + 1, self.chunk.records_mut());
        }
        self.announced = self.channels.len();
    }

    fn close_chunk(&mut self) -> Result<(), WriteError> {
        if self.ended {
            return Err(WriteError::Ended);
        }
        if self.chunk.is_empty() {
            return Ok(());
        }
        let (bytes, place): (Vec<u8>, ChunkPlace) = self.chunk.encode(self.len);
        self.append(&bytes, self.chunk.messages())?;
        self.summary.chunks.push(place);
        self.chunk.clear();
        Ok(())
    }

    fn append(&mut self, bytes: &[u8], messages: u64) -> Result<(), WriteError> {
        match self.store.write_all(bytes) {
            Ok(()) => {
                self.len += bytes.len() as u64;
                Ok(())
            }
            Err(source) => Err(self.fail(source, messages)),
        }
    }

    /// Cuts a half-written piece off. When even that fails the reader still stops at the last whole chunk.
    fn fail(&mut self, source: io::Error, lost_messages: u64) -> WriteError {
        self.ended = true;
        let source = match self.store.cut_to(self.len) {
            Ok(()) => source,
            Err(cut) => {
                io::Error::new(source.kind(), format!("{source}; cutting the file back failed too: {cut}"))
            }
        };
        WriteError::Store { source, kept_messages: self.summary.messages() - lost_messages, lost_messages }
    }
}

impl Channel {
    /// Schema and channel record. Each channel has its own schema id: the same schema twice costs a few hundred bytes
    /// a file and saves a second table.
    pub(crate) fn encode(&self, id: u16, out: &mut Vec<u8>) {
        self.encode_schema(id, out);
        self.encode_channel(id, out);
    }

    pub(crate) fn encode_schema(&self, id: u16, out: &mut Vec<u8>) {
        encode::record(out, op::SCHEMA, |out| {
            encode::u16(out, id);
            encode::string(out, &self.schema_name);
            encode::string(out, "jsonschema");
            encode::bytes(out, self.schema_json.as_bytes());
        });
    }

    pub(crate) fn encode_channel(&self, id: u16, out: &mut Vec<u8>) {
        encode::record(out, op::CHANNEL, |out| {
            encode::u16(out, id);
            encode::u16(out, id);
            encode::string(out, &self.topic);
            encode::string(out, "json");
            encode::string_map(out, &BTreeMap::new());
        });
    }
}
