//! The files of one recording: `run.mcap` alone, or `run-0001.mcap`, `run-0002.mcap` ... in their order.

use std::collections::{BTreeMap, VecDeque};
use std::fmt;
use std::fs::{self, File};
use std::io::{self, BufReader, ErrorKind};
use std::path::{Path, PathBuf};

use crate::contents::Item;
use crate::reader::{Ending, ReadError, RecordingReader};

/// Fewest digits of a file's number in its series.
const NUMBER_DIGITS: usize = 4;

/// A recording of one or of many files.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordingFiles {
    /// Name of its only file, or the common beginning of the files' names.
    pub name: String,
    /// Oldest first; at least one.
    pub files: Vec<PathBuf>,
}

impl RecordingFiles {
    /// A file alone; the rotated files of a folder that holds one recording; or `FOLDER/NAME` of a folder that holds several.
    ///
    /// # Errors
    /// Nothing there, no recording in the folder, or several: the message names them.
    pub fn open(path: &Path) -> io::Result<Self> {
        let refuse = |text: String| Err(io::Error::new(ErrorKind::InvalidInput, text));
        match fs::metadata(path) {
            Ok(found) if !found.is_dir() => {
                let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
                Ok(Self { name, files: vec![path.to_owned()] })
            }
            Ok(_) => {
                let mut all = Self::all_in(path)?;
                match (all.pop(), all.is_empty()) {
                    (Some(only), true) => Ok(only),
                    (None, _) => refuse("expected recordings (.mcap) in the folder, found none".into()),
                    (Some(last), false) => {
                        let names: Vec<String> = all.into_iter().chain([last]).map(|one| one.name).collect();
                        let (found, first) = (names.join(", "), path.join(&names[0]));
                        refuse(format!(
                            "expected one recording, found {found}; name one: {}",
                            first.display()
                        ))
                    }
                }
            }
            Err(missing) => {
                let (folder, name) = (path.parent().unwrap_or(Path::new("")), path.file_name());
                let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
                let found = Self::all_in(folder).unwrap_or_default();
                let wanted = name.unwrap_or_default().to_string_lossy();
                found.into_iter().find(|series| series.name == wanted).ok_or(missing)
            }
        }
    }

    /// All recordings of a folder by name.
    pub fn all_in(folder: &Path) -> io::Result<Vec<Self>> {
        let mut found: BTreeMap<String, Vec<(u64, PathBuf)>> = BTreeMap::new();
        for path in fs::read_dir(folder)?.flatten().map(|entry| entry.path()) {
            let Some(name) = path.file_name().and_then(|name| name.to_str()) else { continue };
            if !name.ends_with(".mcap") {
                continue;
            }
            let (series, number) = split(name, "mcap").unwrap_or((name, 0));
            found.entry(series.to_owned()).or_default().push((number, path.clone()));
        }
        Ok(found.into_iter().map(|(name, files)| Self { name, files: in_order(files) }).collect())
    }

    /// Reads all files, one after the other.
    pub fn reader(&self) -> SeriesReader {
        SeriesReader {
            waiting: self.files.iter().cloned().collect(),
            files: self.files.len(),
            current: None,
            incomplete: Vec::new(),
        }
    }
}

/// The numbered files of the series `stem` in a folder, oldest first, and the highest number.
pub(crate) fn numbered(folder: &Path, stem: &str, suffix: &str) -> io::Result<(Vec<PathBuf>, u64)> {
    let (mut files, mut highest) = (Vec::new(), 0);
    for path in fs::read_dir(folder)?.flatten().map(|entry| entry.path()) {
        let name = path.file_name().and_then(|name| name.to_str());
        let Some((series, number)) = name.and_then(|name| split(name, suffix)) else { continue };
        if series == stem {
            highest = highest.max(number);
            files.push((number, path));
        }
    }
    Ok((in_order(files), highest))
}

fn in_order(mut files: Vec<(u64, PathBuf)>) -> Vec<PathBuf> {
    files.sort();
    files.into_iter().map(|(_, path)| path).collect()
}

/// Series and number of a rotated file, such as `run-0001.mcap`.
fn split<'a>(name: &'a str, suffix: &str) -> Option<(&'a str, u64)> {
    let (series, digits) = name.strip_suffix(suffix)?.strip_suffix('.')?.rsplit_once('-')?;
    let is_number = digits.len() >= NUMBER_DIGITS && digits.bytes().all(|byte| byte.is_ascii_digit());
    Some((series, digits.parse().ok().filter(|_| is_number)?))
}

/// Where items of a recording come from.
pub trait ReadItems {
    /// The next message or metadata; `None` at the end.
    fn next_item(&mut self) -> Result<Option<Item>, ReadError>;
}

impl<R: io::Read> ReadItems for RecordingReader<R> {
    fn next_item(&mut self) -> Result<Option<Item>, ReadError> {
        RecordingReader::next_item(self)
    }
}

/// Reads the files of a series as one recording. Memory: as [`RecordingReader`], whatever the number of files.
pub struct SeriesReader {
    waiting: VecDeque<PathBuf>,
    files: usize,
    current: Option<(PathBuf, RecordingReader<BufReader<File>>)>,
    incomplete: Vec<(PathBuf, Ending)>,
}

impl SeriesReader {
    /// Files that were read and are not whole, with what is wrong.
    pub fn incomplete(&self) -> &[(PathBuf, Ending)] {
        &self.incomplete
    }

    /// How the recording ended, as a string.
    pub fn ending(&self) -> String {
        match self.incomplete.as_slice() {
            [] => Ending::Complete.to_string(),
            [(_, ending)] if self.files == 1 => ending.to_string(),
            [(path, ending), ..] => {
                let (count, files) = (self.incomplete.len(), self.files);
                format!("not whole in {count} of {files} files, the first: {}: {ending}", path.display())
            }
        }
    }

    /// Opens a file. In a series, empty and removed files are skipped: a power cut leaves empty files, and a recorder removes the
    /// oldest.
    fn open(&mut self, path: PathBuf) -> Result<(), ReadError> {
        let in_file = |source: ReadError| ReadError::InFile { path: path.clone(), source: Box::new(source) };
        let opened = open_regular(&path)
            .map_err(ReadError::Io)
            .and_then(|file| RecordingReader::new(BufReader::new(file)));
        let reason = match opened {
            Ok(reader) => {
                self.current = Some((path, reader));
                return Ok(());
            }
            Err(error) if self.files == 1 => return Err(in_file(error)),
            Err(ReadError::NotMcap { .. }) => "it does not begin as a recording does",
            Err(ReadError::Io(error)) if error.kind() == ErrorKind::NotFound => "it was removed meanwhile",
            Err(error) => return Err(in_file(error)),
        };
        self.incomplete.push((path, Ending::Truncated { at_byte: 0, reason }));
        Ok(())
    }
}

impl ReadItems for SeriesReader {
    fn next_item(&mut self) -> Result<Option<Item>, ReadError> {
        loop {
            let Some((path, reader)) = &mut self.current else {
                match self.waiting.pop_front() {
                    Some(path) => self.open(path)?,
                    None => return Ok(None),
                }
                continue;
            };
            let item = reader.next_item();
            let item =
                item.map_err(|source| ReadError::InFile { path: path.clone(), source: Box::new(source) })?;
            if item.is_some() {
                return Ok(item);
            }
            if let Some((path, reader)) = self.current.take() {
                let ending = reader.ending().filter(|ending| **ending != Ending::Complete).cloned();
                self.incomplete.extend(ending.map(|ending| (path, ending)));
            }
        }
    }
}

impl fmt::Debug for SeriesReader {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SeriesReader").field("files", &self.files).field("waiting", &self.waiting).finish()
    }
}

/// Pipes and devices would never end.
fn open_regular(path: &Path) -> io::Result<File> {
    if !fs::metadata(path)?.is_file() {
        return Err(io::Error::new(ErrorKind::InvalidInput, "expected a regular file, found something else"));
    }
    File::open(path)
}
