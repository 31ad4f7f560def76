//! Reads the format's primitives from a slice; every read is checked and none allocates.

/// A position in a record's body.
pub struct Body<'a>(pub &'a [u8]);

impl<'a> Body<'a> {
    pub fn take(&mut self, count: u64) -> Option<&'a [u8]> {
        let (head, tail) = self.0.split_at_checked(usize::try_from(count).ok()?)?;
        self.0 = tail;
        Some(head)
    }

    pub fn u8(&mut self) -> Option<u8> {
        self.take(1)?.first().copied()
    }

    pub fn u16(&mut self) -> Option<u16> {
        Some(u16::from_le_bytes(self.take(2)?.try_into().ok()?))
    }

    pub fn u32(&mut self) -> Option<u32> {
        Some(u32::from_le_bytes(self.take(4)?.try_into().ok()?))
    }

    pub fn u64(&mut self) -> Option<u64> {
        Some(u64::from_le_bytes(self.take(8)?.try_into().ok()?))
    }

    pub fn string(&mut self) -> Option<&'a str> {
        let length = self.u32()?;
        std::str::from_utf8(self.take(u64::from(length))?).ok()
    }

    /// The pairs of a string map.
    pub fn string_map(&mut self) -> Option<Vec<(&'a str, &'a str)>> {
        let length = self.u32()?;
        let mut pairs = Body(self.take(u64::from(length))?);
        let mut map = Vec::new();
        while !pairs.0.is_empty() {
            map.push((pairs.string()?, pairs.string()?));
        }
        Some(map)
    }
}

/// The head of a chunk and its (perhaps compressed) records.
pub struct ChunkBody<'a> {
    pub uncompressed: u64,
    pub checksum: u32,
    pub compression: &'a str,
    pub records: &'a [u8],
}

pub fn chunk(bytes: &[u8]) -> Option<ChunkBody<'_>> {
    let mut body = Body(bytes);
    body.take(16)?;
    let uncompressed = body.u64()?;
    let checksum = body.u32()?;
    let compression = body.string()?;
    let length = body.u64()?;
    Some(ChunkBody { uncompressed, checksum, compression, records: body.take(length)? })
}
