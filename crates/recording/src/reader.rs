//! Reads a recording from start to end, whatever state it is in.

use std::fmt;
use std::io::{self, Read};
use std::path::PathBuf;

use mcap::records::op;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{MAGIC, McapError};
use thiserror::Error;
use wire::layout::LAYOUT_VERSION;

use crate::chunk::{Checksum, Chunk, MAX_RECORD_BYTES, Next, RECORD_HEAD};
use crate::contents::{Contents, Item};
use crate::parse;

/// Content of an uncompressed chunk before its records, bytes.
const CHUNK_HEAD: u64 = 40;
/// Content of the record that ends a file.
const FOOTER_BYTES: usize = 20;
/// Read at once, so that a length field alone allocates no more.
const READ_BYTES: usize = 1 << 16;

/// Why a file cannot be read as a recording at all.
#[derive(Debug, Error)]
pub enum ReadError {
    /// The system refused to read.
    #[error("cannot read the recording: {0}")]
    Io(#[from] io::Error),
    /// Not an MCAP file.
    #[error("expected an MCAP recording (it starts with 89 4d 43 41 50 30 0d 0a), found {found}")]
    NotMcap { found: String },
    /// A recording of another version.
    #[error(
        "expected a recording of layout {LAYOUT_VERSION}, found {found}; record again with `softtwin record` of this version"
    )]
    Layout { found: String },
    /// A compression that is not supported.
    #[error(
        "expected chunks compressed with lz4, zstd or not at all, found {found}; rewrite the file with `mcap compress \
         --compression lz4 IN -o OUT`"
    )]
    Compression { found: String },
    /// Nothing to show or to export.
    #[error("{place}: expected a recording with states (softtwin/NAME/state), found none")]
    NoStates { place: String },
    /// Reading takes minutes and was stopped.
    #[error("stopped while {place} was read")]
    Stopped { place: String },
    /// In a file of a series.
    #[error("{}: {source}", path.display())]
    InFile { path: PathBuf, source: Box<ReadError> },
}

/// How a recording ended; known when [`RecordingReader::next_item`] has returned `None`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Ending {
    /// With its footer, and every chunk was whole.
    Complete,
    /// It stops early: the writer was killed, or the file was cut. What came before was read.
    Truncated {
        /// The byte at which reading stopped.
        at_byte: u64,
        reason: &'static str,
    },
    /// It has its footer, but some chunks or records were damaged and left out.
    Damaged {
        /// How many were left out.
        skipped: u64,
    },
}

impl fmt::Display for Ending {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Complete => f.write_str("complete"),
            Self::Truncated { at_byte, reason } => {
                write!(f, "cut short at byte {at_byte} ({reason}); everything before can be read")
            }
            Self::Damaged { skipped } => write!(f, "damaged: {skipped} chunks or records were left out"),
        }
    }
}

/// Reads a recording record by record. Memory: one record and one compressed chunk, each of at most [`MAX_RECORD_BYTES`].
pub struct RecordingReader<R: Read> {
    input: R,
    /// Where the next record begins.
    at_byte: u64,
    /// Bytes taken from the input.
    taken_bytes: u64,
    file: LinearReader,
    /// The chunk whose records are read.
    chunk: Option<Chunk>,
    /// The chunk too long for memory whose records are read.
    long: Option<LongChunk>,
    has_chunks: bool,
    contents: Contents,
    ending: Option<Ending>,
}

impl<R: Read> RecordingReader<R> {
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
            taken_bytes: MAGIC.len() as u64,
            file: LinearReader::new_with_options(options().with_emit_chunks(true)),
            chunk: None,
            long: None,
            has_chunks: false,
            contents: Contents::default(),
            ending: None,
        })
    }

    /// The next message or metadata; `None` at the end, which [`RecordingReader::ending`] then describes.
    ///
    /// # Errors
    /// [`ReadError::Io`], [`ReadError::Compression`] and [`ReadError::Layout`]. Truncation and damage are no errors: they end or shorten the
    /// recording and are reported by [`RecordingReader::ending`].
    pub fn next_item(&mut self) -> Result<Option<Item>, ReadError> {
        while self.ending.is_none() {
            let item = match &self.chunk {
                Some(_) => self.step_in_chunk(),
                None => self.step_in_file()?,
            };
            if let Some(item) = item {
                check_layout(&item)?;
                return Ok(Some(item));
            }
        }
        Ok(None)
    }

    /// How the recording ended; `None` before the end was reached.
    pub fn ending(&self) -> Option<&Ending> {
        self.ending.as_ref()
    }

    fn step_in_chunk(&mut self) -> Option<Item> {
        match self.chunk.as_mut()?.next() {
            Next::Record { opcode, record } => return self.contents.take(opcode, record),
            Next::TooLong => self.contents.skipped += 1,
            Next::Damaged => (self.chunk, self.contents.skipped) = (None, self.contents.skipped + 1),
            Next::End => self.chunk = None,
        }
        None
    }

    fn step_in_file(&mut self) -> Result<Option<Item>, ReadError> {
        if self.long.as_ref().is_some_and(|long| self.at_byte >= long.end) {
            return self.leave_chunk().map(|()| None);
        }
        let (opcode, record) = match self.file.next_event() {
            Some(Ok(LinearReadEvent::Record { opcode, data })) => (opcode, data),
            Some(Ok(LinearReadEvent::ReadRequest(wanted))) => {
                let count = read(&mut self.input, self.file.insert(wanted.min(READ_BYTES)))?;
                self.file.notify_read(count);
                self.taken_bytes += count as u64;
                return Ok(None);
            }
            Some(Err(McapError::RecordTooLarge { opcode, len })) if may_be_long(opcode) => {
                let entered = opcode == op::CHUNK && self.long.is_none() && self.enter_chunk(len)?;
                return if entered { Ok(None) } else { self.skip_record(opcode, len).map(|()| None) };
            }
            failed => {
                let reason = match failed {
                    Some(Err(McapError::RecordTooLarge { .. })) => {
                        "a record claims more bytes than any recording holds"
                    }
                    Some(Err(error)) if !matches!(error, McapError::UnexpectedEof) => {
                        "the end of the data is damaged"
                    }
                    _ if self.taken_bytes == self.at_byte => {
                        "the file ends between two records, without a footer"
                    }
                    _ => "the file ends inside a record",
                };
                self.ending = Some(Ending::Truncated { at_byte: self.at_byte, reason });
                return Ok(None);
            }
        };
        self.at_byte += (RECORD_HEAD + record.len()) as u64;
        if let Some(long) = &mut self.long {
            long.checksum.add_head(opcode, record.len() as u64);
            long.checksum.add(record);
        }
        match opcode {
            // Of another length it is something else whose opcode was damaged.
            op::FOOTER if record.len() == FOOTER_BYTES => {
                self.ending = Some(match self.contents.damage() {
                    0 => Ending::Complete,
                    skipped => Ending::Damaged { skipped },
                });
            }
            op::CHUNK => {
                self.has_chunks = true;
                self.chunk = Chunk::open(record).map_err(|found| ReadError::Compression { found })?;
                self.contents.skipped += u64::from(self.chunk.is_none());
            }
            // Outside chunks nothing has a checksum: where there are chunks, a message outside is a damaged index.
            op::MESSAGE if self.has_chunks && self.long.is_none() => self.contents.skipped += 1,
            _ => return Ok(self.contents.take(opcode, record)),
        }
        Ok(None)
    }
}

impl<R: Read> RecordingReader<R> {
    /// Leaves out a record that is too long for memory, of which the head was read. Its length is a claim: the file may end before.
    fn skip_record(&mut self, opcode: u8, len: u64) -> Result<(), ReadError> {
        let end = self.at_byte.saturating_add(RECORD_HEAD as u64).saturating_add(len);
        if let Some(long) = &mut self.long {
            long.checksum.add_head(opcode, len);
        }
        self.has_chunks |= opcode == op::CHUNK;
        self.contents.skipped += 1;
        self.pass(end)
    }

    /// Continues at this byte; the bytes before it count for the checksum of a long chunk.
    fn pass(&mut self, end: u64) -> Result<(), ReadError> {
        let rest = end.saturating_sub(self.taken_bytes);
        let mut passed = self.input.by_ref().take(rest);
        let count = match &mut self.long {
            Some(long) => io::copy(&mut passed, &mut long.checksum)?,
            None => io::copy(&mut passed, &mut io::sink())?,
        };
        if count < rest {
            let reason = "the file ends inside a record";
            self.ending = Some(Ending::Truncated { at_byte: self.at_byte, reason });
            return Ok(());
        }
        (self.at_byte, self.taken_bytes) = (end, end);
        self.file = LinearReader::new_with_options(options().with_emit_chunks(true));
        Ok(())
    }

    /// Reads the records of an uncompressed chunk that is too long for memory as those of the file. False: it is compressed or damaged.
    fn enter_chunk(&mut self, len: u64) -> Result<bool, ReadError> {
        let mut head = Vec::new();
        self.input.by_ref().take(CHUNK_HEAD.min(len)).read_to_end(&mut head)?;
        self.taken_bytes += head.len() as u64;
        let Some((checksum, length)) = parse::uncompressed_chunk(&head) else { return Ok(false) };
        if length > len.saturating_sub(CHUNK_HEAD) {
            return Ok(false);
        }
        let behind = self.at_byte.saturating_add(RECORD_HEAD as u64).saturating_add(len);
        let end = self.taken_bytes.saturating_add(length);
        self.pass(self.taken_bytes)?;
        self.long = Some(LongChunk { end, behind, expected: checksum, checksum: Checksum::default() });
        self.has_chunks = true;
        Ok(true)
    }

    /// Its records were delivered before its checksum could be compared: a wrong one is counted.
    fn leave_chunk(&mut self) -> Result<(), ReadError> {
        let Some(long) = self.long.take() else { return Ok(()) };
        let is_damaged = long.expected != 0 && long.checksum.value() != long.expected;
        self.contents.skipped += u64::from(is_damaged || self.at_byte > long.end);
        self.pass(long.behind.max(self.at_byte))
    }
}

/// An uncompressed chunk of more than [`MAX_RECORD_BYTES`] in the file.
struct LongChunk {
    /// Where its records end.
    end: u64,
    /// Where the next record of the file begins.
    behind: u64,
    /// Its checksum; 0: none.
    expected: u32,
    checksum: Checksum,
}

/// True for records that have any length in a whole file, those of other programs among them.
fn may_be_long(opcode: u8) -> bool {
    matches!(opcode, op::MESSAGE | op::CHUNK | op::ATTACHMENT | op::METADATA) || opcode >= 0x80
}

/// Refuses a recording whose payloads have another layout. Files of other programs have no such metadata.
fn check_layout(item: &Item) -> Result<(), ReadError> {
    match item {
        Item::Metadata { name, entries } if name == crate::ABOUT => match entries.get(crate::LAYOUT) {
            Some(found) if *found == LAYOUT_VERSION.to_string() => Ok(()),
            found => Err(ReadError::Layout { found: found.map_or("none", String::as_str).into() }),
        },
        _ => Ok(()),
    }
}

fn options() -> LinearReaderOptions {
    LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_record_length_limit(MAX_RECORD_BYTES as usize)
}

/// As [`Read::read`], again when a signal came.
fn read(input: &mut impl Read, buffer: &mut [u8]) -> io::Result<usize> {
    loop {
        match input.read(buffer) {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            other => return other,
        }
    }
}
