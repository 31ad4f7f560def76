//! Counts, numbers and lists of integers; the lists as byte planes, deflated.

use crate::error::Diagnostic;
use flate2::bufread::ZlibDecoder;
use miniz_oxide::deflate::core::{
    CompressionStrategy, CompressorOxide, TDEFLFlush, compress_to_output, create_comp_flags_from_zip_params,
};
use std::io::Read;

pub(super) struct Writer(Vec<u8>);

impl Writer {
    pub(crate) fn new(magic: &[u8; 8], version: u32) -> Self {
        let mut bytes = magic.to_vec();
        bytes.extend(version.to_le_bytes());
        Self(bytes)
    }

    pub(crate) fn count(&mut self, value: usize) {
        self.0.extend((value as u64).to_le_bytes());
    }

    pub(crate) fn number(&mut self, value: f64) {
        self.0.extend(value.to_le_bytes());
    }

    /// Appends integers: zigzag (small for small magnitudes), then one plane per byte; the upper planes are zeros.
    pub(crate) fn integers(&mut self, values: &[i32]) {
        let zigzag: Vec<u32> = values.iter().map(|v| ((v << 1) ^ (v >> 31)) as u32).collect();
        let planes = (0..4).map(|p| zigzag.iter().map(|z| (z >> (8 * p)) as u8).collect());
        let packed = deflate(&planes.collect::<Vec<Vec<u8>>>());
        self.count(packed.len());
        self.0.extend(packed);
    }

    /// Appends the checksum of everything before it.
    pub(crate) fn finish(mut self) -> Vec<u8> {
        let sum = checksum(&self.0);
        self.0.extend(sum.to_le_bytes());
        self.0
    }
}

pub(super) struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    /// Reader after the head, and the version in the head.
    pub(crate) fn new(bytes: &'a [u8], magic: &[u8; 8], versions: &[u32]) -> Result<(Self, u32), Diagnostic> {
        let rest = bytes
            .strip_prefix(magic)
            .ok_or_else(|| Diagnostic::new("first bytes", "those of packed snapshots", "others"))?;
        let (body, sum) = rest
            .split_last_chunk::<8>()
            .ok_or_else(|| Diagnostic::new("file", "a checksum at its end", "less"))?;
        let expected = checksum(&bytes[..bytes.len() - 8]);
        if u64::from_le_bytes(*sum) != expected {
            return Err(Diagnostic::new(
                "checksum",
                format!("{expected:016x}"),
                "another: the file is damaged",
            ));
        }
        let mut reader = Self(body);
        let found = u32::from_le_bytes(reader.take("version")?);
        if !versions.contains(&found) {
            return Err(Diagnostic::new("version", format!("one of {versions:?}"), found));
        }
        Ok((reader, found))
    }

    pub(crate) fn count(&mut self, what: &str) -> Result<usize, Diagnostic> {
        let value = u64::from_le_bytes(self.take(what)?);
        usize::try_from(value).map_err(|_| Diagnostic::new(what, "a count that fits into memory", value))
    }

    pub(crate) fn number(&mut self, what: &str) -> Result<f64, Diagnostic> {
        Ok(f64::from_le_bytes(self.take(what)?))
    }

    /// Reads a list of `expected` integers.
    pub(crate) fn integers(&mut self, expected: usize) -> Result<Vec<i32>, Diagnostic> {
        let length = self.count("block")?;
        let wrong = |found: String| Diagnostic::new("block", format!("{expected} integers"), found);
        let (packed, rest) =
            self.0.split_at_checked(length).ok_or_else(|| wrong(format!("{} bytes left", self.0.len())))?;
        self.0 = rest;
        let mut planes = Vec::new(); // grows with what is really there
        let bound = (expected as u64).saturating_mul(4) + 1;
        ZlibDecoder::new(packed).take(bound).read_to_end(&mut planes).map_err(|e| wrong(e.to_string()))?;
        if planes.len() != expected * 4 {
            return Err(wrong(format!("{} bytes", planes.len())));
        }
        let plane = |p: usize| &planes[p * expected..(p + 1) * expected];
        let bytes = plane(0).iter().zip(plane(1)).zip(plane(2)).zip(plane(3));
        Ok(bytes
            .map(|(((a, b), c), d)| {
                let zigzag = u32::from_le_bytes([*a, *b, *c, *d]);
                (zigzag >> 1) as i32 ^ -((zigzag & 1) as i32)
            })
            .collect())
    }

    pub(crate) fn end(&self) -> Result<(), Diagnostic> {
        if self.0.is_empty() {
            Ok(())
        } else {
            Err(Diagnostic::new("end", "nothing more", format!("{} bytes", self.0.len())))
        }
    }

    fn take<const N: usize>(&mut self, what: &str) -> Result<[u8; N], Diagnostic> {
        let (head, rest) = self
            .0
            .split_first_chunk()
            .ok_or_else(|| Diagnostic::new(what, format!("{N} bytes"), "the end of the file"))?;
        self.0 = rest;
        Ok(*head)
    }
}

/// One zlib stream of all planes. Remainders of a prediction repeat only zeros: a search for runs with a separate code per plane
/// is 10 % smaller than a search for all repetitions.
fn deflate(planes: &[Vec<u8>]) -> Vec<u8> {
    let mut out = Vec::new();
    let flags = create_comp_flags_from_zip_params(9, 15, CompressionStrategy::RLE as i32);
    let mut compressor = CompressorOxide::new(flags);
    for (p, plane) in planes.iter().enumerate() {
        let flush = if p + 1 == planes.len() { TDEFLFlush::Finish } else { TDEFLFlush::Sync };
        // Takes all of its input where the output has no limit.
        compress_to_output(&mut compressor, plane, flush, |bytes| {
            out.extend_from_slice(bytes);
            true
        });
    }
    out
}

/// FNV-1a (Fowler, Noll, Vo), 64 bits: detects accidental damage. The reader's checks detect deliberate changes.
fn checksum(bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325, |sum, byte| (sum ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3))
}
