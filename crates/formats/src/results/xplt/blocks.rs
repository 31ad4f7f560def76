//! Blocks of FEBio's plot file: a number, a size, then data or further blocks.

use crate::error::Diagnostic;
use flate2::bufread::ZlibDecoder;
use std::io::Read;

/// First word of a file; the other byte order has it reversed.
const TAG: u32 = 0x0046_4542;

/// Bytes with their order.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bytes<'a> {
    pub(super) data: &'a [u8],
    big_endian: bool,
}

impl<'a> Bytes<'a> {
    /// A file behind its tag.
    pub(super) fn open(file: &'a [u8]) -> Result<Self, Diagnostic> {
        let head = file.first_chunk::<4>().copied().unwrap_or_default();
        let big_endian = match (u32::from_le_bytes(head), u32::from_be_bytes(head)) {
            (TAG, _) => false,
            (_, TAG) => true,
            _ => return Err(Diagnostic::new("byte 0", "FEBio's tag (42 45 46 00)", format!("{head:02x?}"))),
        };
        Ok(Self { data: &file[4..], big_endian })
    }

    fn with(self, data: &'a [u8]) -> Self {
        Self { data, ..self }
    }

    fn word(self, bytes: [u8; 4]) -> u32 {
        if self.big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) }
    }

    /// All whole numbers.
    pub(super) fn words(self) -> impl Iterator<Item = u32> + 'a {
        self.data.as_chunks::<4>().0.iter().map(move |bytes| self.word(*bytes))
    }

    /// All numbers.
    pub(super) fn floats(self) -> impl Iterator<Item = f64> + 'a {
        self.words().map(|word| f64::from(f32::from_bits(word)))
    }

    /// The first whole number.
    pub(super) fn first(self) -> Option<u32> {
        self.words().next()
    }

    /// Text up to its end or the first zero.
    pub(super) fn text(self) -> String {
        let end = self.data.iter().position(|byte| *byte == 0).unwrap_or(self.data.len());
        String::from_utf8_lossy(&self.data[..end]).into_owned()
    }

    /// The block at the beginning and what follows it; `None` where it goes beyond the end.
    pub(super) fn split(self) -> Option<(u32, Self, Self)> {
        let (head, rest) = self.data.split_first_chunk::<8>()?;
        let [id, size] = [0, 4].map(|at| self.word([head[at], head[at + 1], head[at + 2], head[at + 3]]));
        let (data, after) = rest.split_at_checked(size as usize)?;
        Some((id, self.with(data), self.with(after)))
    }

    /// All blocks within.
    pub(super) fn blocks(self) -> Result<Vec<(u32, Self)>, Diagnostic> {
        let (mut found, mut rest) = (Vec::new(), self);
        while !rest.data.is_empty() {
            let Some((id, data, after)) = rest.split() else {
                let expected = "blocks that end within the one that holds them";
                return Err(Diagnostic::new("blocks", expected, "one that is longer"));
            };
            found.push((id, data));
            rest = after;
        }
        Ok(found)
    }

    /// The first block of that number.
    pub(super) fn block(self, id: u32) -> Result<Option<Self>, Diagnostic> {
        Ok(self.blocks()?.into_iter().find(|block| block.0 == id).map(|block| block.1))
    }

    /// A section that was compressed by itself (zlib), and how many bytes it took; `None` where it is damaged or longer than
    /// the limit. Memory grows with what is there.
    pub(super) fn inflate(self, limit: u64) -> Option<(Vec<u8>, usize)> {
        let mut decoder = ZlibDecoder::new(self.data);
        let mut section = Vec::new();
        decoder.by_ref().take(limit + 1).read_to_end(&mut section).ok()?;
        let taken = decoder.total_in() as usize;
        (taken > 0 && section.len() as u64 <= limit).then_some((section, taken))
    }

    /// The same order for other bytes.
    pub(super) fn like<'b>(self, data: &'b [u8]) -> Bytes<'b> {
        Bytes { data, big_endian: self.big_endian }
    }
}
