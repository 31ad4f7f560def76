//! Fields of the records that readers need, with every length checked against the available bytes.
//!
//! `mcap::parse_record` is not used: for a string with a length field of 4 GB it reserves 4 GB (test `a_claimed_length_reserves_nothing`),
//! and it panics on a short attachment.

/// The unread rest of a record.
pub struct Body<'a>(pub &'a [u8]);

impl<'a> Body<'a> {
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

/// Bytes of a chunk record up to the end of its compressed records; what follows is padding.
pub fn chunk_length(record: &[u8]) -> Option<usize> {
    let mut body = Body(record);
    body.take(28)?; // times, size and checksum
    body.bytes()?; // compression
    let records_length = body.u64()?;
    body.take(usize::try_from(records_length).ok()?)?;
    Some(record.len() - body.0.len())
}
