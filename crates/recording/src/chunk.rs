//! Records of one chunk, decompressed one after another: memory holds one of them.

use crate::parse;
use std::io::{self, Cursor, Read, Write};

/// Largest record, and largest compressed chunk, that a reader takes into memory: 64 MiB. A longer one is left out.
///
/// A field of 125,110 values is half a megabyte, so a chunk of ours stays far below.
pub const MAX_RECORD_BYTES: u64 = 64 << 20;

/// Opcode and length in front of every record, bytes.
pub(crate) const RECORD_HEAD: usize = 9;

/// Longest decompressed chunk that is read: 1 GiB. Of a longer one all records are left out.
const MAX_CHUNK_BYTES: u64 = 1 << 30;

/// A chunk whose checksum is right.
pub(crate) struct Chunk {
    records: Box<dyn Read + Send>,
    /// Decompressed bytes that were not read yet.
    left: u64,
    record: Vec<u8>,
}

/// Next thing in a chunk.
pub(crate) enum Next<'a> {
    Record {
        opcode: u8,
        record: &'a [u8],
    },
    /// A record that is too long for memory was left out.
    TooLong,
    /// The rest is damaged.
    Damaged,
    End,
}

impl Chunk {
    /// Checks a chunk record. `None`: its lengths do not fit, or its checksum is wrong.
    ///
    /// # Errors
    /// The name of another compression than lz4 and zstd.
    pub(crate) fn open(record: &[u8]) -> Result<Option<Self>, String> {
        let Some(head) = parse::chunk(record).filter(|head| head.size <= MAX_CHUNK_BYTES) else {
            return Ok(None);
        };
        if head.checksum != 0 {
            let mut checksum = Checksum::default();
            let records = decoder(head.compression, head.records)?;
            let count = records.and_then(|records| io::copy(&mut records.take(head.size), &mut checksum));
            if count.ok() != Some(head.size) || checksum.value() != head.checksum {
                return Ok(None);
            }
        }
        let records = decoder(head.compression, Cursor::new(head.records.to_vec()))?;
        Ok(records.ok().map(|records| Self { records, left: head.size, record: Vec::new() }))
    }

    pub(crate) fn next(&mut self) -> Next<'_> {
        if self.left == 0 {
            return Next::End;
        }
        let mut head = [0; RECORD_HEAD];
        if self.records.read_exact(&mut head).is_err() {
            return Next::Damaged;
        }
        let [opcode, length @ ..] = head;
        let length = u64::from_le_bytes(length);
        let Some(left) = self.left.checked_sub(RECORD_HEAD as u64).and_then(|left| left.checked_sub(length))
        else {
            return Next::Damaged;
        };
        self.left = left;
        let mut content = self.records.by_ref().take(length);
        let is_long = length > MAX_RECORD_BYTES;
        self.record.clear();
        let count = match is_long {
            true => io::copy(&mut content, &mut io::sink()),
            false => content.read_to_end(&mut self.record).map(|count| count as u64),
        };
        match count {
            Ok(count) if count == length && is_long => Next::TooLong,
            Ok(count) if count == length => Next::Record { opcode, record: &self.record },
            _ => Next::Damaged,
        }
    }
}

/// # Errors
/// The name of another compression.
fn decoder<'a>(
    compression: &str,
    records: impl Read + Send + 'a,
) -> Result<io::Result<Box<dyn Read + Send + 'a>>, String> {
    Ok(match compression {
        "" => Ok(Box::new(records)),
        "lz4" => lz4::Decoder::new(records).map(|decoder| Box::new(decoder) as _),
        "zstd" => zstd::Decoder::new(records).map(|decoder| Box::new(decoder) as _),
        found => return Err(found.chars().take(32).collect()),
    })
}

/// CRC-32 of what is written to it.
#[derive(Default)]
pub(crate) struct Checksum(crc32fast::Hasher);

impl Checksum {
    pub(crate) fn add(&mut self, bytes: &[u8]) {
        self.0.update(bytes);
    }

    /// Adds opcode and length of a record.
    pub(crate) fn add_head(&mut self, opcode: u8, length: u64) {
        self.0.update(&[opcode]);
        self.0.update(&length.to_le_bytes());
    }

    pub(crate) fn value(self) -> u32 {
        self.0.finalize()
    }
}

impl Write for Checksum {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.add(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
