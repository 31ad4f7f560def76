//! Reads a recording from start to end, whatever state it is in.

use std::collections::{BTreeMap, HashMap};
use std::io::{self, Read};
use std::sync::Arc;

use thiserror::Error;

use crate::parse::{self, Body};
use crate::{ChannelInfo, MAGIC, MAX_RECORD_BYTES, SharedChannel, op};

/// Channels a reader remembers; a file that announces more is not a recording but an attack on memory.
const MAX_CHANNELS: usize = 4096;

/// Why a file cannot be read as a recording at all.
#[derive(Debug, Error)]
pub enum ReadError {
    /// The system refused to read.
    #[error("cannot read the recording: {0}")]
    Io(#[from] io::Error),
    /// Not an MCAP file.
    #[error("expected an MCAP recording (it starts with 89 4d 43 41 50 30 0d 0a), found {found}")]
    NotMcap {
        /// The first bytes of the file.
        found: String,
    },
    /// A compression that is not read here.
    #[error(
        "expected chunks compressed with lz4 or not at all, found {found}; rewrite the file with `mcap compress \
         --compression lz4 IN -o OUT`"
    )]
    Compression {
        /// Its name in the file.
        found: String,
    },
}

/// One message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Message {
    /// Where it was published.
    pub channel: SharedChannel,
    /// Low 32 bits of the publisher's sequence number.
    pub sequence: u32,
    /// When it was recorded, nanoseconds since 1970.
    pub log_time_ns: u64,
    /// When it was published, nanoseconds since 1970.
    pub publish_time_ns: u64,
    /// The message itself.
    pub data: Vec<u8>,
}

/// What a recording consists of.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Item {
    /// A message.
    Message(Message),
    /// A named table of texts.
    Metadata {
        /// Its name.
        name: String,
        /// Its entries.
        entries: BTreeMap<String, String>,
    },
}

/// How a recording ended; known when [`Reader::next_item`] has returned `None`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Ending {
    /// With its footer, and every chunk was whole.
    Complete,
    /// It stops early: the writer was killed, or the file was cut. What came before was read.
    Truncated {
        /// The byte at which reading stopped.
        at_byte: u64,
        /// What was wrong there.
        reason: &'static str,
    },
    /// It has its footer, but some chunks or records were damaged and left out.
    Damaged {
        /// How many were left out.
        skipped: u64,
    },
}

/// Reads a recording record by record. Memory: one record and one chunk, each of at most [`MAX_RECORD_BYTES`].
pub struct Reader<R: Read> {
    input: R,
    at_byte: u64,
    schemas: HashMap<u16, String>,
    channels: HashMap<u16, SharedChannel>,
    chunk: Vec<u8>,
    chunk_at: usize,
    chunks: u64,
    delivered: u64,
    promised: Option<u64>,
    skipped: u64,
    ending: Option<Ending>,
}

/// What one record turned out to be.
enum Step {
    Item(Item),
    Continue,
    End,
}

impl<R: Read> Reader<R> {
    /// Checks the head of the file.
    ///
    /// # Errors
    /// [`ReadError::NotMcap`], or [`ReadError::Io`].
    pub fn new(mut input: R) -> Result<Self, ReadError> {
        let mut head = Vec::new();
        input.by_ref().take(MAGIC.len() as u64).read_to_end(&mut head)?;
        if head != MAGIC {
            let found = if head.is_empty() { "an empty file".into() } else { format!("{head:02x?}") };
            return Err(ReadError::NotMcap { found });
        }
        Ok(Self {
            input,
            at_byte: MAGIC.len() as u64,
            schemas: HashMap::new(),
            channels: HashMap::new(),
            chunk: Vec::new(),
            chunk_at: 0,
            chunks: 0,
            delivered: 0,
            promised: None,
            skipped: 0,
            ending: None,
        })
    }

    /// The next message or metadata; `None` at the end, which [`Reader::ending`] then describes.
    ///
    /// # Errors
    /// [`ReadError::Io`] and [`ReadError::Compression`]. Truncation and damage are no errors: they end or shorten the
    /// recording and are reported by [`Reader::ending`].
    pub fn next_item(&mut self) -> Result<Option<Item>, ReadError> {
        while self.ending.is_none() {
            let step =
                if self.chunk_at < self.chunk.len() { self.step_in_chunk() } else { self.step_in_file()? };
            match step {
                Step::Item(item) => return Ok(Some(item)),
                Step::Continue => {}
                Step::End => {
                    let ending = self.whole_or_damaged();
                    self.ending.get_or_insert(ending);
                }
            }
        }
        Ok(None)
    }

    /// How the recording ended; `None` before the end was reached.
    pub fn ending(&self) -> Option<&Ending> {
        self.ending.as_ref()
    }

    /// The file's own count of messages also betrays a chunk whose kind was damaged, and that was passed over unseen.
    fn whole_or_damaged(&self) -> Ending {
        let unseen = self.promised.map_or(0, |promised| promised.abs_diff(self.delivered));
        match self.skipped.max(u64::from(unseen > 0)) {
            0 => Ending::Complete,
            skipped => Ending::Damaged { skipped },
        }
    }

    fn step_in_chunk(&mut self) -> Step {
        let chunk = std::mem::take(&mut self.chunk);
        let mut body = Body(chunk.get(self.chunk_at..).unwrap_or_default());
        let step = match (body.u8(), body.u64().and_then(|length| body.take(length))) {
            (Some(opcode), Some(record)) => {
                self.chunk_at = chunk.len() - body.0.len();
                self.record(opcode, record)
            }
            // The checksum held and the records still do not add up: leave the rest of this chunk out.
            _ => {
                self.chunk_at = chunk.len();
                self.skipped += 1;
                Step::Continue
            }
        };
        self.chunk = chunk;
        step
    }

    fn step_in_file(&mut self) -> Result<Step, ReadError> {
        let start = self.at_byte;
        let head = self.read_up_to(9)?;
        let mut body = Body(&head);
        let (Some(opcode), Some(length)) = (body.u8(), body.u64()) else {
            return Ok(self.truncated(start, "the file ends between two records, without a footer"));
        };
        if length > MAX_RECORD_BYTES {
            return Ok(self.truncated(start, "a record claims more bytes than any recording holds"));
        }
        let record = self.read_up_to(length)?;
        if (record.len() as u64) < length {
            return Ok(self.truncated(start, "the file ends inside a record"));
        }
        match opcode {
            op::FOOTER => Ok(Step::End),
            op::CHUNK => self.open_chunk(&record),
            // Outside chunks nothing is checked: where there are chunks, a message out there is a damaged index.
            op::MESSAGE if self.chunks > 0 => {
                self.skipped += 1;
                Ok(Step::Continue)
            }
            _ => Ok(self.record(opcode, &record)),
        }
    }

    /// Grows with what is really there, so that a length field alone allocates nothing.
    fn read_up_to(&mut self, count: u64) -> Result<Vec<u8>, ReadError> {
        let mut bytes = Vec::new();
        self.input.by_ref().take(count).read_to_end(&mut bytes)?;
        self.at_byte += bytes.len() as u64;
        Ok(bytes)
    }

    fn truncated(&mut self, at_byte: u64, reason: &'static str) -> Step {
        self.ending = Some(Ending::Truncated { at_byte, reason });
        Step::End
    }

    fn open_chunk(&mut self, record: &[u8]) -> Result<Step, ReadError> {
        self.chunks += 1;
        let Some(chunk) = parse::chunk(record) else {
            self.skipped += 1;
            return Ok(Step::Continue);
        };
        let records = match chunk.compression {
            "" => Some(chunk.records.to_vec()),
            "lz4" => decompress(chunk.records, chunk.uncompressed),
            other => return Err(ReadError::Compression { found: other.chars().take(32).collect() }),
        };
        let whole =
            records.filter(|records| chunk.checksum == 0 || crc32fast::hash(records) == chunk.checksum);
        match whole {
            Some(records) => (self.chunk, self.chunk_at) = (records, 0),
            None => self.skipped += 1,
        }
        Ok(Step::Continue)
    }

    fn record(&mut self, opcode: u8, record: &[u8]) -> Step {
        let mut body = Body(record);
        let known = match opcode {
            op::SCHEMA => self.schema(&mut body).map(|()| Step::Continue),
            op::CHANNEL => self.channel(&mut body).map(|()| Step::Continue),
            op::MESSAGE => self.message(&mut body).map(Step::Item),
            op::METADATA => metadata(&mut body).map(Step::Item),
            op::STATISTICS => body.u64().map(|promised| {
                self.promised = Some(promised);
                Step::Continue
            }),
            _ => Some(Step::Continue),
        };
        known.unwrap_or_else(|| {
            self.skipped += 1;
            Step::Continue
        })
    }

    fn schema(&mut self, body: &mut Body) -> Option<()> {
        let (id, name) = (body.u16()?, body.string()?);
        if self.schemas.len() < MAX_CHANNELS {
            self.schemas.insert(id, name.to_owned());
        }
        Some(())
    }

    fn channel(&mut self, body: &mut Body) -> Option<()> {
        let (id, schema) = (body.u16()?, body.u16()?);
        let (topic, encoding) = (body.string()?, body.string()?);
        let info = ChannelInfo {
            topic: topic.to_owned(),
            message_encoding: encoding.to_owned(),
            schema_name: self.schemas.get(&schema).cloned().unwrap_or_default(),
        };
        // Every chunk repeats its channels: the same one stays, so that its messages go on sharing it.
        let is_known = self.channels.get(&id).is_some_and(|known| **known == info);
        if !is_known && (self.channels.len() < MAX_CHANNELS || self.channels.contains_key(&id)) {
            self.channels.insert(id, Arc::new(info));
        }
        Some(())
    }

    fn message(&mut self, body: &mut Body) -> Option<Item> {
        let channel = self.channels.get(&body.u16()?)?.clone();
        let (sequence, log_time_ns, publish_time_ns) = (body.u32()?, body.u64()?, body.u64()?);
        self.delivered += 1;
        Some(Item::Message(Message {
            channel,
            sequence,
            log_time_ns,
            publish_time_ns,
            data: body.0.to_vec(),
        }))
    }
}

fn metadata(body: &mut Body) -> Option<Item> {
    let name = body.string()?.to_owned();
    let pairs = body.string_map()?;
    let entries = pairs.into_iter().map(|(key, value)| (key.to_owned(), value.to_owned())).collect();
    Some(Item::Metadata { name, entries })
}

/// Expands at most what the chunk announces, and never more than [`MAX_RECORD_BYTES`].
fn decompress(frame: &[u8], uncompressed: u64) -> Option<Vec<u8>> {
    if uncompressed > MAX_RECORD_BYTES {
        return None;
    }
    let mut records = Vec::new();
    lz4_flex::frame::FrameDecoder::new(frame).take(uncompressed + 1).read_to_end(&mut records).ok()?;
    (records.len() as u64 == uncompressed).then_some(records)
}
