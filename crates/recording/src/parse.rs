//! Fields of the records that readers need, with every length checked against the available bytes.
//!
//! `mcap::parse_record` is not used: for a string with a length field of 4 GB it reserves 4 GB (test `a_claimed_length_reserves_nothing`),
//! and it panics on a short attachment.

/// The unread rest of a record.
pub struct RecordBody<'a>(pub &'a [u8]);

impl<'a> RecordBody<'a> {
    pub fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (head, tail) = self.0.split_at_checked(count)?;
        self.0 = tail;
        Some(head)
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

    /// A length of 32 bits and as many bytes.
    pub fn bytes(&mut self) -> Option<&'a [u8]> {
        let length = self.u32()?;
        self.take(length as usize)
    }

    pub fn string(&mut self) -> Option<&'a str> {
        std::str::from_utf8(self.bytes()?).ok()
    }
}

pub struct Chunk<'a> {
    /// Length of the decompressed records.
    pub size: u64,
    /// CRC-32 of the decompressed records; 0: none.
    pub checksum: u32,
    /// Name of the compression; empty: none.
    pub compression: &'a str,
    pub records: &'a [u8],
}

/// Checksum and length of the records of a chunk without compression, from what is before them.
pub fn uncompressed_chunk(head: &[u8]) -> Option<(u32, u64)> {
    let mut body = RecordBody(head);
    body.take(24)?; // times and size
    let checksum = body.u32()?;
    (body.u32()? == 0).then_some(())?; // no compression
    Some((checksum, body.u64()?))
}

/// Parts of a chunk record; what follows its records is padding.
pub fn chunk(record: &[u8]) -> Option<Chunk<'_>> {
    let mut body = RecordBody(record);
    body.take(16)?; // times
    let (size, checksum, compression) = (body.u64()?, body.u32()?, body.string()?);
    let length = body.u64()?;
    let records = body.take(usize::try_from(length).ok()?)?;
    Some(Chunk { size, checksum, compression, records })
}
