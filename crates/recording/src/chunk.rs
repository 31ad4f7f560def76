//! A chunk while it is being filled: records, their index, and the bytes that go to disk when it is closed.

use std::collections::BTreeMap;

use crate::{encode, op};

/// Where a closed chunk landed; kept for the summary at the end of the file.
pub struct ChunkPlace {
    pub start_time_ns: u64,
    pub end_time_ns: u64,
    pub offset: u64,
    pub length: u64,
    pub index_offsets: BTreeMap<u16, u64>,
    pub index_length: u64,
    pub compressed: u64,
    pub uncompressed: u64,
}

/// An open chunk in memory.
#[derive(Default)]
pub struct Chunk {
    records: Vec<u8>,
    index: BTreeMap<u16, Vec<(u64, u64)>>,
    bounds_ns: Option<(u64, u64)>,
    messages: u64,
}

impl Chunk {
    /// Messages in this chunk so far.
    pub fn messages(&self) -> u64 {
        self.messages
    }

    /// Bytes of records so far, before compression.
    pub fn len(&self) -> usize {
        self.records.len()
    }

    pub fn is_empty(&self) -> bool {
        self.records.is_empty()
    }

    /// Records other than messages: schemas and channels.
    pub fn records_mut(&mut self) -> &mut Vec<u8> {
        &mut self.records
    }

    /// Appends one message.
    pub fn push(&mut self, channel: u16, sequence: u32, log_time_ns: u64, publish_time_ns: u64, data: &[u8]) {
        let offset = self.records.len() as u64;
        encode::record(&mut self.records, op::MESSAGE, |out| {
            encode::u16(out, channel);
            encode::u32(out, sequence);
            encode::u64(out, log_time_ns);
            encode::u64(out, publish_time_ns);
            out.extend_from_slice(data);
        });
        self.index.entry(channel).or_default().push((log_time_ns, offset));
        let (first, last) = self.bounds_ns.unwrap_or((log_time_ns, log_time_ns));
        self.bounds_ns = Some((first.min(log_time_ns), last.max(log_time_ns)));
        self.messages += 1;
    }

    /// The chunk record and its message indexes as they will stand in the file at `offset`, and their place.
    ///
    /// Nothing is consumed: when the write fails the chunk is still whole.
    pub fn encode(&self, offset: u64) -> (Vec<u8>, ChunkPlace) {
        let compressed = compress(&self.records);
        let (start_time_ns, end_time_ns) = self.bounds_ns.unwrap_or((0, 0));
        let mut out = Vec::with_capacity(compressed.len() + 1024);
        encode::record(&mut out, op::CHUNK, |out| {
            encode::u64(out, start_time_ns);
            encode::u64(out, end_time_ns);
            encode::u64(out, self.records.len() as u64);
            encode::u32(out, crc32fast::hash(&self.records));
            encode::string(out, "lz4");
            encode::u64(out, compressed.len() as u64);
            out.extend_from_slice(&compressed);
        });
        let length = out.len() as u64;
        let mut index_offsets = BTreeMap::new();
        for (channel, entries) in &self.index {
            index_offsets.insert(*channel, offset + out.len() as u64);
            encode_index(&mut out, *channel, entries);
        }
        let place = ChunkPlace {
            start_time_ns,
            end_time_ns,
            offset,
            length,
            index_offsets,
            index_length: out.len() as u64 - length,
            compressed: compressed.len() as u64,
            uncompressed: self.records.len() as u64,
        };
        (out, place)
    }

    /// Forgets everything and keeps the memory of the records.
    pub fn clear(&mut self) {
        self.records.clear();
        self.index.clear();
        self.bounds_ns = None;
        self.messages = 0;
    }
}

fn encode_index(out: &mut Vec<u8>, channel: u16, entries: &[(u64, u64)]) {
    encode::record(out, op::MESSAGE_INDEX, |out| {
        encode::u16(out, channel);
        encode::sized(out, |out| {
            for (time_ns, offset) in entries {
                encode::u64(out, *time_ns);
                encode::u64(out, *offset);
            }
        });
    });
}

/// LZ4 frame of `records`. Writing into memory cannot fail; were the encoder to refuse, an empty frame would not match
/// the checksum and the reader would say so.
fn compress(records: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::with_capacity(records.len() / 3 + 64));
    encoder.write_all(records).map_err(Into::into).and_then(|()| encoder.finish()).unwrap_or_default()
}
