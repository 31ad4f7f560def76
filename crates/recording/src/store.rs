//! Where a recording is written: staged in memory chunk by chunk, then into a file (or, in tests, memory).

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Bytes are appended to it; it can be cut back to a known length and forced to disk.
pub trait Store: Write {
    /// Cuts the store to `len` bytes and continues writing there.
    fn cut_to(&mut self, len: u64) -> io::Result<()>;

    /// Forces what was written onto the medium.
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

/// Bytes written by the crate and not yet in the file. Clones share them: the crate owns one.
#[derive(Clone, Default)]
pub(crate) struct Staging(Arc<Mutex<StagedBytes>>);

#[derive(Default)]
pub(crate) struct StagedBytes {
    /// Bytes already in the file.
    pub file_bytes: u64,
    /// Bytes that follow them.
    pub bytes: Vec<u8>,
}

impl Staging {
    /// Used by one thread only, so this never blocks.
    pub fn lock(&self) -> MutexGuard<'_, StagedBytes> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Write for Staging {
    fn write(&mut self, data: &[u8]) -> io::Result<usize> {
        self.lock().bytes.write(data)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for Staging {
    /// Supports only queries of the position: the crate does not seek ([`mcap::WriteOptions::disable_seeking`]).
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let staged = self.lock();
        match to {
            SeekFrom::Current(0) => Ok(staged.file_bytes + staged.bytes.len() as u64),
            _ => Err(io::ErrorKind::Unsupported.into()),
        }
    }
}
