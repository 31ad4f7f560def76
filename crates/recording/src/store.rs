//! What a recording is written to: a file, or memory in tests.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};

/// Bytes are appended to it; it can be cut back to a known length and forced to disk.
pub trait Store: Write {
    /// Cuts the store to `len` bytes and continues writing there.
    ///
    /// # Errors
    /// The system's error.
    fn cut_to(&mut self, len: u64) -> io::Result<()>;

    /// Forces what was written onto the medium.
    ///
    /// # Errors
    /// The system's error.
    fn sync(&mut self) -> io::Result<()>;
}

impl Store for File {
    fn cut_to(&mut self, len: u64) -> io::Result<()> {
        self.set_len(len)?;
        self.seek(SeekFrom::Start(len)).map(|_| ())
    }

    fn sync(&mut self) -> io::Result<()> {
        self.sync_data()
    }
}

impl Store for Vec<u8> {
    fn cut_to(&mut self, len: u64) -> io::Result<()> {
        self.truncate(len as usize);
        Ok(())
    }

    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }
}
