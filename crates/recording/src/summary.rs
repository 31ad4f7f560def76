//! The tail of a finished file: what is in it and where, so that viewers open it without reading it through.

use std::collections::BTreeMap;

use crate::chunk::ChunkPlace;
use crate::writer::Channel;
use crate::{MAGIC, encode, op};

/// Where a metadata record stands.
pub struct MetadataPlace {
    pub offset: u64,
    pub length: u64,
    pub name: String,
}

/// Counted while writing.
#[derive(Default)]
pub struct Summary {
    pub chunks: Vec<ChunkPlace>,
    pub metadata: Vec<MetadataPlace>,
    counts: BTreeMap<u16, u64>,
    bounds_ns: Option<(u64, u64)>,
}

impl Summary {
    pub fn count(&mut self, channel: u16, log_time_ns: u64) {
        *self.counts.entry(channel).or_default() += 1;
        let (first, last) = self.bounds_ns.unwrap_or((log_time_ns, log_time_ns));
        self.bounds_ns = Some((first.min(log_time_ns), last.max(log_time_ns)));
    }

    pub fn messages(&self) -> u64 {
        self.counts.values().sum()
    }

    /// End of data, summary, offsets, footer and closing magic, as they stand from byte `at` on.
    pub fn encode(&self, at: u64, channels: &[Channel]) -> Vec<u8> {
        let mut out = Vec::new();
        encode::record(&mut out, op::DATA_END, |out| encode::u32(out, 0));
        let summary_from = out.len();
        let mut groups = Vec::new();
        let mut group = |out: &mut Vec<u8>, opcode: u8, fill: &dyn Fn(&mut Vec<u8>)| {
            let from = out.len();
            fill(out);
            if out.len() > from {
                groups.push((opcode, at + from as u64, (out.len() - from) as u64));
            }
        };
        let numbered = || (1u16..).zip(channels);
        group(&mut out, op::SCHEMA, &|out| {
            numbered().for_each(|(id, channel)| channel.encode_schema(id, out))
        });
        group(&mut out, op::CHANNEL, &|out| {
            numbered().for_each(|(id, channel)| channel.encode_channel(id, out))
        });
        group(&mut out, op::STATISTICS, &|out| self.encode_statistics(out, channels.len()));
        group(&mut out, op::CHUNK_INDEX, &|out| {
            self.chunks.iter().for_each(|place| encode_chunk_index(out, place))
        });
        group(&mut out, op::METADATA_INDEX, &|out| self.encode_metadata_index(out));
        let offsets_from = out.len();
        for (opcode, start, length) in groups {
            encode::record(&mut out, op::SUMMARY_OFFSET, |out| {
                out.push(opcode);
                encode::u64(out, start);
                encode::u64(out, length);
            });
        }
        encode_footer(&mut out, at, summary_from, offsets_from);
        out.extend_from_slice(&MAGIC);
        out
    }

    fn encode_statistics(&self, out: &mut Vec<u8>, channels: usize) {
        let (first, last) = self.bounds_ns.unwrap_or((0, 0));
        encode::record(out, op::STATISTICS, |out| {
            encode::u64(out, self.messages());
            encode::u16(out, channels as u16);
            encode::u32(out, channels as u32);
            encode::u32(out, 0);
            encode::u32(out, self.metadata.len() as u32);
            encode::u32(out, self.chunks.len() as u32);
            encode::u64(out, first);
            encode::u64(out, last);
            encode::sized(out, |out| {
                for (channel, count) in &self.counts {
                    encode::u16(out, *channel);
                    encode::u64(out, *count);
                }
            });
        });
    }

    fn encode_metadata_index(&self, out: &mut Vec<u8>) {
        for place in &self.metadata {
            encode::record(out, op::METADATA_INDEX, |out| {
                encode::u64(out, place.offset);
                encode::u64(out, place.length);
                encode::string(out, &place.name);
            });
        }
    }
}

fn encode_chunk_index(out: &mut Vec<u8>, place: &ChunkPlace) {
    encode::record(out, op::CHUNK_INDEX, |out| {
        encode::u64(out, place.start_time_ns);
        encode::u64(out, place.end_time_ns);
        encode::u64(out, place.offset);
        encode::u64(out, place.length);
        encode::sized(out, |out| {
            for (channel, offset) in &place.index_offsets {
                encode::u16(out, *channel);
                encode::u64(out, *offset);
            }
        });
        encode::u64(out, place.index_length);
        encode::string(out, "lz4");
        encode::u64(out, place.compressed);
        encode::u64(out, place.uncompressed);
    });
}

/// The footer's checksum covers the summary and the footer's own first fields.
fn encode_footer(out: &mut Vec<u8>, at: u64, summary_from: usize, offsets_from: usize) {
    out.push(op::FOOTER);
    encode::u64(out, 20);
    encode::u64(out, at + summary_from as u64);
    encode::u64(out, at + offsets_from as u64);
    let checksum = crc32fast::hash(&out[summary_from..]);
    encode::u32(out, checksum);
}
