//! A recording over many files: a new one by size or by time, the oldest removed when only so many are to be kept.

use std::collections::{BTreeMap, VecDeque};
use std::fs::{self, File};
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use crate::writer::{Channel, WriteError, Writer};

/// When a new file is begun.
#[derive(Debug, Clone, Copy, Default)]
pub struct RotateOptions {
    /// Begin a new file at this many bytes.
    pub max_bytes: Option<u64>,
    /// Begin a new file after this many nanoseconds of recorded time.
    pub max_time_ns: Option<u64>,
    /// Keep only this many files of this run; older ones are removed.
    pub keep: Option<usize>,
}

/// What was recorded over all files.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RotateSummary {
    /// Messages written, also those in files that were removed since.
    pub messages: u64,
    /// Files that are still there, oldest first.
    pub files: Vec<PathBuf>,
    /// Files removed because of [`RotateOptions::keep`].
    pub removed: u64,
}

/// Writes `base.mcap`, or `base-0001.mcap`, `base-0002.mcap` ... when it rotates.
pub struct RotatingWriter {
    base: PathBuf,
    options: RotateOptions,
    writer: Option<Writer<File>>,
    metadata: BTreeMap<String, BTreeMap<String, String>>,
    started_ns: Option<u64>,
    number: u64,
    messages: u64,
    files: VecDeque<PathBuf>,
    removed: u64,
}

impl RotatingWriter {
    /// Opens the first file. An existing file is never overwritten.
    ///
    /// # Errors
    /// [`WriteError::Exists`], [`WriteError::Create`], [`WriteError::Store`].
    pub fn create(base: &Path, options: RotateOptions) -> Result<Self, WriteError> {
        let mut rotating = Self {
            base: base.to_owned(),
            options,
            writer: None,
            metadata: BTreeMap::new(),
            started_ns: None,
            number: 0,
            messages: 0,
            files: VecDeque::new(),
            removed: 0,
        };
        rotating.open_next()?;
        Ok(rotating)
    }

    /// Adds one message, in a new file when the current one is full.
    ///
    /// # Errors
    /// [`WriteError`].
    pub fn message(
        &mut self,
        channel: &Channel,
        sequence: u32,
        log_time_ns: u64,
        publish_time_ns: u64,
        data: &[u8],
    ) -> Result<(), WriteError> {
        if self.is_full(log_time_ns) {
            self.close()?;
            self.open_next()?;
        }
        self.started_ns.get_or_insert(log_time_ns);
        let writer = self.writer.as_mut().ok_or(WriteError::Ended)?;
        let id = writer.channel(channel)?;
        writer.message(id, sequence, log_time_ns, publish_time_ns, data)?;
        self.messages += 1;
        Ok(())
    }

    /// Adds metadata to this file and to every later one, so that each file can be read alone.
    ///
    /// # Errors
    /// [`WriteError`].
    pub fn metadata(&mut self, name: &str, entries: &BTreeMap<String, String>) -> Result<(), WriteError> {
        self.writer.as_mut().ok_or(WriteError::Ended)?.metadata(name, entries)?;
        self.metadata.insert(name.to_owned(), entries.clone());
        Ok(())
    }

    /// Forces everything so far onto the medium.
    ///
    /// # Errors
    /// [`WriteError`], also when the file was deleted meanwhile.
    pub fn flush(&mut self) -> Result<(), WriteError> {
        let writer = self.writer.as_mut().ok_or(WriteError::Ended)?;
        writer.flush()?;
        require_name(writer.store(), self.files.back())
    }

    /// Closes the last file.
    ///
    /// # Errors
    /// [`WriteError`].
    pub fn finish(mut self) -> Result<RotateSummary, WriteError> {
        self.close()?;
        Ok(RotateSummary { messages: self.messages, files: self.files.into(), removed: self.removed })
    }

    fn is_full(&self, now_ns: u64) -> bool {
        let bytes = self.writer.as_ref().map_or(0, Writer::bytes);
        let age_ns = self.started_ns.map_or(0, |started| now_ns.saturating_sub(started));
        let too_big = self.options.max_bytes.is_some_and(|max| bytes >= max);
        self.started_ns.is_some() && (too_big || self.options.max_time_ns.is_some_and(|max| age_ns >= max))
    }

    fn close(&mut self) -> Result<(), WriteError> {
        self.started_ns = None;
        let file = self.writer.take().ok_or(WriteError::Ended)?.finish()?;
        require_name(&file, self.files.back())
    }

    fn open_next(&mut self) -> Result<(), WriteError> {
        self.number += 1;
        let path = self.path();
        let opened = File::options().write(true).create_new(true).open(&path);
        let file = opened.map_err(|cause| self.refused(&path, cause))?;
        let mut writer = Writer::new(file)?;
        for (name, entries) in &self.metadata {
            writer.metadata(name, entries)?;
        }
        self.writer = Some(writer);
        self.files.push_back(path);
        self.remove_oldest();
        Ok(())
    }

    fn refused(&self, path: &Path, cause: io::Error) -> WriteError {
        let path = path.to_owned();
        match (self.files.is_empty(), cause.kind()) {
            (true, io::ErrorKind::AlreadyExists) => WriteError::Exists { path },
            (true, _) => WriteError::Create { path, cause },
            (false, kind) => WriteError::Store {
                source: io::Error::new(kind, format!("{}: {cause}", path.display())),
                kept_messages: self.messages,
                lost_messages: 0,
            },
        }
    }

    /// A file that cannot be removed stays in the list's place on disk: recording matters more than tidiness.
    fn remove_oldest(&mut self) {
        while self.options.keep.is_some_and(|keep| self.files.len() > keep.max(1)) {
            if let Some(path) = self.files.pop_front()
                && fs::remove_file(&path).is_ok()
            {
                self.removed += 1;
            }
        }
    }

    fn path(&self) -> PathBuf {
        if self.options.max_bytes.is_none() && self.options.max_time_ns.is_none() {
            return self.base.clone();
        }
        let stem = self.base.file_stem().unwrap_or_default().to_string_lossy();
        let suffix = self.base.extension().map_or("mcap".into(), |suffix| suffix.to_string_lossy());
        self.base.with_file_name(format!("{stem}-{:04}.{suffix}", self.number))
    }
}

/// A file without a name vanishes with the last program that has it open.
fn require_name(file: &File, path: Option<&PathBuf>) -> Result<(), WriteError> {
    match file.metadata().map(|about| about.nlink()) {
        Ok(0) => Err(WriteError::Deleted { path: path.cloned().unwrap_or_default() }),
        _ => Ok(()),
    }
}
