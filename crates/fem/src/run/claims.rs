//! Claims on cases between machines that share a folder: a lock on a file, which the kernel releases when its holder ends,
//! however it ends.
//!
//! On a network file system the lock is the server's: NFS 4 gives it back when the lease of a machine that is gone has run
//! out (about 90 seconds), SMB when its connection is closed. A file system without locks is refused, because there an
//! unfinished case could not be told from a lost one.

use formats::{FormatError, file};
use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};

/// The folder of the claims.
#[derive(Debug)]
pub(super) struct Claims {
    folder: PathBuf,
}

/// A claim; dropped, it is given back.
#[derive(Debug)]
pub(super) struct Claim {
    _file: File,
}

impl Claims {
    pub(super) fn new(folder: &Path) -> Result<Self, FormatError> {
        file::create_folder(folder)?;
        Ok(Self { folder: folder.into() })
    }

    /// Claims what is named like the file given; `None` while another process or thread holds it. The file of a claim is
    /// empty and stays: removed, two could hold it.
    ///
    /// # Errors
    /// The operating system's, as where the file system knows no locks.
    pub(super) fn take(&self, named: &Path) -> Result<Option<Claim>, FormatError> {
        let path = self.folder.join(named.file_name().unwrap_or_default());
        let open = File::options().create(true).truncate(false).write(true).open(&path);
        let file = open.map_err(|error| FormatError::write(&path, error))?;
        match file.try_lock() {
            Ok(()) => Ok(Some(Claim { _file: file })),
            Err(TryLockError::WouldBlock) => Ok(None),
            Err(TryLockError::Error(error)) => Err(FormatError::write(&path, error)),
        }
    }
}
