//! Opening the files that a start is configured with. Pipes and devices would never end, so they are refused.

pub use formats::file::named_in;
pub use rom::model::MAX_MODEL_BYTES;
use std::fs::{self, File};
use std::io::{Error, ErrorKind, Read, Result};
use std::path::Path;

/// Largest scene or settings file, bytes: 16 MiB.
pub const MAX_TEXT_BYTES: u64 = 16 << 20;

/// Opens a regular file of at most `limit` bytes.
///
/// # Errors
/// I/O errors; a folder, device or pipe; a longer file.
pub fn open(path: &Path, limit: u64) -> Result<File> {
    // Asked before the file is opened: opening a pipe waits for its writer.
    let metadata = fs::metadata(path)?;
    let refuse = |text: String| Err(Error::new(ErrorKind::InvalidInput, text));
    if !metadata.is_file() {
        let found = if metadata.is_dir() { "a folder" } else { "a device or pipe" };
        return refuse(format!("expected a regular file, found {found}"));
    }
    if metadata.len() > limit {
        return refuse(format!("expected at most {limit} bytes, found {}", metadata.len()));
    }
    File::open(path)
}

/// The content of a regular file of at most `limit` bytes.
///
/// # Errors
/// As [`open`].
pub fn read(path: &Path, limit: u64) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    // Files that grow while they are read, and those of /proc, whose length is 0, end at the limit too.
    open(path, limit)?.take(limit).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// The text of a regular file of at most `limit` bytes.
///
/// # Errors
/// As [`open`]; bytes that are not UTF-8.
pub fn read_text(path: &Path, limit: u64) -> Result<String> {
    String::from_utf8(read(path, limit)?).map_err(|error| {
        let found = formats::file::other_than_text(error.as_bytes()).unwrap_or("other bytes");
        Error::new(ErrorKind::InvalidData, format!("expected UTF-8 text, found {found}"))
    })
}
