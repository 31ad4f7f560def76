//! Access to files: reading up to a maximum size, and atomic replacement.

use crate::error::{Diagnostic, FormatError};
use serde::de::DeserializeOwned;
use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Component, Path, PathBuf};

/// Largest description or table (TOML, JSON, lists of cases) that is read: 64 MiB.
pub const MAX_TEXT_BYTES: u64 = 64 << 20;

/// Largest array, mesh or matrix that is read: 8 GiB.
pub const MAX_DATA_BYTES: u64 = 8 << 30;

/// Most columns of a table. No bench and no solver writes more; a line with more is not a table, or one with the wrong separator.
pub const MAX_COLUMNS: usize = 10_000;

/// Refuses a table whose line `line` has more than [`MAX_COLUMNS`] columns.
///
/// # Errors
/// That place.
pub fn check_columns(line: usize, columns: usize) -> Result<(), Diagnostic> {
    if columns <= MAX_COLUMNS {
        return Ok(());
    }
    Err(Diagnostic::new(format!("line {line}"), format!("at most {MAX_COLUMNS} columns"), columns))
}

/// First bytes of files that are no text, with what they are.
const MAGIC: [(&[u8], &str); 8] = [
    (&[0x1f, 0x8b], "a gzip archive; unpack it first (gunzip)"),
    (
        b"PK\x03\x04",
        "a zip archive or a workbook; unpack it, or export the sheet as CSV (pandas.read_excel(FILE).to_csv(OUT, index=False))",
    ),
    (b"\xfd7zXZ", "an xz archive; unpack it first (unxz)"),
    (&[0x28, 0xb5, 0x2f, 0xfd], "a zstd archive; unpack it first (unzstd)"),
    (b"BZh", "a bzip2 archive; unpack it first (bunzip2)"),
    (b"TDSm", "a TDMS file; write it as CSV (nptdms.TdmsFile(FILE).as_dataframe().to_csv(OUT))"),
    (b"#ROSBAG", "a ROS bag; write its topics as CSV (rosbags, or ros2 bag convert)"),
    (b"\x89HDF", "an HDF5 file; export its table as CSV"),
];
/// Bytes from which text is told from other content, and the part of control characters that text has at most.
const LOOKED_AT: usize = 1 << 16;
const MOST_CONTROLS: f64 = 0.02;

/// What a file is, if it is no text. Whether it is UTF-8 does not tell that: in Latin-1 every byte is a character.
#[must_use]
pub fn other_than_text(bytes: &[u8]) -> Option<&'static str> {
    if let Some((_, what)) = MAGIC.iter().find(|(magic, _)| bytes.starts_with(magic)) {
        return Some(what);
    }
    let begin = bytes.get(..LOOKED_AT).unwrap_or(bytes);
    let is_control = |byte: &&u8| **byte < b' ' && !b"\t\n\r\x0b\x0c\x1a\x1b".contains(byte);
    let controls = begin.iter().filter(is_control).count();
    (controls as f64 > MOST_CONTROLS * begin.len() as f64).then_some("control characters: binary data")
}

/// Path that the file `file` has in a key, a table or a line: relative ones count from its folder.
pub fn named_in(file: &Path, path: impl AsRef<Path>) -> PathBuf {
    file.parent().unwrap_or(Path::new("")).join(path)
}

/// Opens a regular file of at most `limit` bytes and returns it with its length in bytes.
///
/// # Errors
/// I/O error; a folder, device or pipe; a longer file.
pub fn open(path: &Path, limit: u64) -> Result<(File, u64), FormatError> {
    let unreadable = |error| FormatError::read(path, error);
    // Asked before the file is opened: opening a pipe waits for its writer.
    let metadata = fs::metadata(path).map_err(unreadable)?;
    if !metadata.is_file() {
        let found = if metadata.is_dir() { "a folder" } else { "a device or pipe" };
        return Err(FormatError::one(path, Diagnostic::new("file", "a regular file", found)));
    }
    if metadata.len() > limit {
        let (expected, found) = (format!("at most {limit} bytes"), format!("{} bytes", metadata.len()));
        return Err(FormatError::one(path, Diagnostic::new("file", expected, found)));
    }
    Ok((File::open(path).map_err(unreadable)?, metadata.len()))
}

/// Reads a regular file of at most `limit` bytes.
///
/// # Errors
/// As [`open`]; a file that does not fit into memory.
pub fn read_bytes(path: &Path, limit: u64) -> Result<Vec<u8>, FormatError> {
    let (file, length) = open(path, limit)?;
    let mut bytes = Vec::new();
    let memory = |_| FormatError::read(path, io::ErrorKind::OutOfMemory.into());
    bytes.try_reserve_exact(length as usize).map_err(memory)?;
    // Files that grow while they are read, and those of /proc, whose length is 0, end at the limit too.
    file.take(limit).read_to_end(&mut bytes).map_err(|error| FormatError::read(path, error))?;
    Ok(bytes)
}

/// Reads a regular file of at most `limit` bytes as UTF-8.
///
/// # Errors
/// As [`read_bytes`]; bytes that are not UTF-8.
pub fn read_text(path: &Path, limit: u64) -> Result<String, FormatError> {
    let bytes = read_bytes(path, limit)?;
    String::from_utf8(bytes).map_err(|error| {
        let found = other_than_text(error.as_bytes()).unwrap_or("other bytes");
        FormatError::one(path, Diagnostic::new("content", "UTF-8 text", found))
    })
}

/// Reads a typed value from a TOML file of at most [`MAX_TEXT_BYTES`]; `expected` describes its keys.
///
/// # Errors
/// As [`read_text`]; content that is not TOML with these keys.
pub(crate) fn read_toml<T: DeserializeOwned>(path: &Path, expected: &str) -> Result<T, FormatError> {
    let text = read_text(path, MAX_TEXT_BYTES)?;
    toml::from_str(&text).map_err(|error| {
        FormatError::one(path, Diagnostic::new("content", expected, error.to_string().trim_end()))
    })
}

/// Replaces a file atomically: a reader sees the old content or the new one, also after a crash.
///
/// Through a symbolic link its target is replaced. Devices and pipes (`/dev/stdout`) are written to directly.
///
/// # Errors
/// I/O error; the old file is unchanged then.
pub fn replace(path: &Path, bytes: &[u8]) -> Result<(), FormatError> {
    let write = || -> io::Result<()> {
        let target = fs::canonicalize(path).unwrap_or_else(|_| path.into());
        if fs::metadata(&target).is_ok_and(|metadata| !metadata.is_file()) {
            return fs::write(&target, bytes);
        }
        // The process id keeps two programs that write the same file apart.
        let mut partial = target.clone().into_os_string();
        partial.push(format!(".part{}", std::process::id()));
        let partial = PathBuf::from(partial);
        let written = File::create(&partial).and_then(|mut file| {
            file.write_all(bytes)?;
            file.sync_all()
        });
        written.and_then(|()| fs::rename(&partial, &target)).inspect_err(|_| drop(fs::remove_file(&partial)))
    };
    write().map_err(|error| FormatError::write(path, error))
}

pub fn copy(from: &Path, to: &Path) -> Result<(), FormatError> {
    fs::copy(from, to).map(drop).map_err(|error| FormatError::write(to, error))
}

/// Creates a folder with its parents.
pub fn create_folder(path: &Path) -> Result<(), FormatError> {
    fs::create_dir_all(path).map_err(|error| FormatError::write(path, error))
}

/// True if `name` is a file name without folders.
pub fn is_plain_name(name: &str) -> bool {
    let mut parts = Path::new(name).components();
    matches!((parts.next(), parts.next()), (Some(Component::Normal(_)), None))
}

/// A path for a printed command, quoted where a shell would split or change it.
pub fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    let plain = |c: char| c.is_alphanumeric() || "_./:=+,@%-".contains(c);
    if !text.is_empty() && text.chars().all(plain) {
        text
    } else {
        format!("'{}'", text.replace('\'', r"'\''"))
    }
}

/// Endings that `softtwin-convert` of the Python client reads.
const CONVERTED: [&str; 11] = ["xdmf", "xmf", "xplt", "cdb", "rpt", "vtk", "med", "e", "exo", "bdf", "nas"];
/// Endings with another remedy.
const ELSEWHERE: [(&str, &str); 5] = [
    ("h5", "softtwin-convert on the .xdmf that lists its data sets"),
    ("case", "open the EnSight case in ParaView and save its data as .pvd"),
    ("odb", "write mesh (.inp) and fields (.csv) with Abaqus' Python: docs/import.md"),
    ("rst", "write mesh (CDWRITE, .cdb) and nodal results (PRNSOL, .txt): docs/import.md"),
    ("dat", "name the .frd of the same job; its .dat is read with it"),
];

/// Error for an ending that no reader accepts, with the command that converts the file to `target`.
pub(crate) fn unreadable(path: &Path, expected: &str, target: &str) -> FormatError {
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
    let found = ending.as_ref().map_or_else(|| "no ending".into(), |ending| format!(".{ending}"));
    let ending = ending.unwrap_or_default();
    let remedy = if CONVERTED.contains(&ending.as_str()) {
        let out = path.with_extension(target);
        Some(format!("softtwin-convert {} --out {}", quoted(path), quoted(&out)))
    } else {
        ELSEWHERE.iter().find(|(known, _)| *known == ending).map(|(_, remedy)| (*remedy).to_owned())
    };
    let expected =
        remedy.map_or_else(|| expected.into(), |remedy| format!("{expected}; convert it: {remedy}"));
    FormatError::one(path, Diagnostic::new("file name", expected, found))
}
