//! A recording over many files: a new one by size or by time, the oldest removed when only so much is to be kept.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, ErrorKind};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use crate::retention::{Retention, RoomyStore, SeriesFiles, SharedFiles, with_room};
use crate::series;
use crate::writer::{Channel, WriteError, Writer};

/// When a new file is begun.
#[derive(Debug, Clone, Copy, Default)]
pub struct RotateOptions {
    /// Begin a new file at this many bytes.
    pub max_bytes: Option<u64>,
    /// Begin a new file after this many nanoseconds of recorded time.
    pub max_time_ns: Option<u64>,
    /// Limits of the series, including files of earlier runs.
    pub keep: Retention,
}

impl RotateOptions {
    /// Whether there is more than one file.
    fn rotates(&self) -> bool {
        self.max_bytes.is_some() || self.max_time_ns.is_some()
    }
}

/// Summary over all files.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RotateSummary {
    /// Messages written, including those in removed files.
    pub messages: u64,
    /// Files of this run that are still there, oldest first.
    pub files: Vec<PathBuf>,
    /// Files removed because of [`RotateOptions::keep`], those of earlier runs too.
    pub removed: u64,
}

/// Disk use of a series.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct DiskUse {
    /// Files of the series, those of earlier runs too.
    pub files: usize,
    pub bytes: u64,
    /// Files removed by this run.
    pub removed: u64,
}

/// Writes `base.mcap`, or `base-0001.mcap`, `base-0002.mcap` ... when it rotates; numbers continue
/// after those of earlier runs.
pub struct RotatingWriter {
    base: PathBuf,
    options: RotateOptions,
    writer: Option<Writer<RoomyStore<File>>>,
    metadata: BTreeMap<String, BTreeMap<String, String>>,
    started_ns: Option<u64>,
    number: u64,
    messages: u64,
    current: PathBuf,
    files: SharedFiles,
}

impl RotatingWriter {
    /// Opens the first file. An existing file is never overwritten.
    ///
    /// # Errors
    /// [`WriteError::Exists`] without rotation, [`WriteError::Create`], [`WriteError::Store`].
    pub fn create(base: &Path, options: RotateOptions) -> Result<Self, WriteError> {
        let folder = base.parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = folder.unwrap_or(Path::new(".")).to_owned();
        let (stem, suffix) = names(base);
        let refused = |cause| WriteError::Create { path: base.to_owned(), cause };
        let (earlier, number) = match options.rotates() {
            true => series::numbered(&folder, &stem, &suffix).map_err(refused)?,
            false => (Vec::new(), 0),
        };
        let files = SharedFiles::new(SeriesFiles::new(folder, options.keep, earlier));
        let mut rotating = Self {
            base: base.to_owned(),
            options,
            writer: None,
            metadata: BTreeMap::new(),
            started_ns: None,
            number,
            messages: 0,
            current: PathBuf::new(),
            files,
        };
        rotating.open_next()?;
        Ok(rotating)
    }

    /// Adds one message, in a new file when the current one is full.
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
    pub fn metadata(&mut self, name: &str, entries: &BTreeMap<String, String>) -> Result<(), WriteError> {
        self.writer.as_mut().ok_or(WriteError::Ended)?.metadata(name, entries)?;
        self.metadata.insert(name.to_owned(), entries.clone());
        Ok(())
    }

    /// Forces everything so far onto the medium and removes what is not to be kept.
    ///
    /// # Errors
    /// [`WriteError`], also when the file was deleted meanwhile.
    pub fn flush(&mut self) -> Result<(), WriteError> {
        let writer = self.writer.as_mut().ok_or(WriteError::Ended)?;
        writer.flush()?;
        require_name(writer.store().inner(), &self.current)?;
        let bytes = writer.bytes();
        self.files.lock().enforce(bytes);
        Ok(())
    }

    /// Ends the current file and begins the next one, where there are several and it holds a message; otherwise a flush.
    pub fn begin_new_file(&mut self) -> Result<(), WriteError> {
        if !self.options.rotates() || self.started_ns.is_none() {
            return self.flush();
        }
        self.close()?;
        self.open_next()
    }

    /// Current disk use of the series.
    pub fn disk_use(&self) -> DiskUse {
        let files = self.files.lock();
        let (bytes, count) = files.closed();
        let current = self.writer.as_ref().map_or(0, Writer::bytes);
        DiskUse { files: count + 1, bytes: bytes + current, removed: files.removed() }
    }

    /// Closes the last file.
    pub fn finish(mut self) -> Result<RotateSummary, WriteError> {
        self.close()?;
        let files = self.files.lock();
        let removed = files.removed();
        Ok(RotateSummary { messages: self.messages, files: files.own().cloned().collect(), removed })
    }

    fn is_full(&self, now_ns: u64) -> bool {
        let bytes = self.writer.as_ref().map_or(0, Writer::bytes);
        let age_ns = self.started_ns.map_or(0, |started| now_ns.saturating_sub(started));
        let quarter = self.options.keep.total_bytes.filter(|_| self.options.rotates()).map(|all| all / 4);
        let too_big = self.options.max_bytes.into_iter().chain(quarter).any(|max| bytes >= max);
        self.started_ns.is_some() && (too_big || self.options.max_time_ns.is_some_and(|max| age_ns >= max))
    }

    fn close(&mut self) -> Result<(), WriteError> {
        self.started_ns = None;
        let store = self.writer.take().ok_or(WriteError::Ended)?.finish()?;
        self.files.lock().push(self.current.clone(), true);
        require_name(store.inner(), &self.current)
    }

    fn open_next(&mut self) -> Result<(), WriteError> {
        let file = loop {
            self.number += 1;
            self.current = self.path();
            let create = || File::options().write(true).create_new(true).open(&self.current);
            match with_room(&self.files, create) {
                // A second recorder of this series was quicker.
                Err(error) if error.kind() == ErrorKind::AlreadyExists && self.options.rotates() => {}
                opened => break opened.map_err(|cause| self.refused(&self.current, cause))?,
            }
        };
        // The lock marks the file as written for other recorders of the series. File systems without locks are accepted.
        let _ = file.try_lock();
        let mut writer = Writer::new(RoomyStore::new(file, self.files.clone()))?;
        for (name, entries) in &self.metadata {
            writer.metadata(name, entries)?;
        }
        let bytes = writer.bytes();
        self.writer = Some(writer);
        self.files.lock().enforce(bytes);
        Ok(())
    }

    fn refused(&self, path: &Path, cause: io::Error) -> WriteError {
        let path = path.to_owned();
        match (self.messages == 0, cause.kind()) {
            (true, ErrorKind::AlreadyExists) => WriteError::Exists { path },
            (true, _) => WriteError::Create { path, cause },
            (false, kind) => WriteError::Store {
                source: io::Error::new(kind, format!("{}: {cause}", path.display())),
                kept_messages: self.messages,
                lost_messages: 0,
            },
        }
    }

    fn path(&self) -> PathBuf {
        if !self.options.rotates() {
            return self.base.clone();
        }
        let (stem, suffix) = names(&self.base);
        self.base.with_file_name(format!("{stem}-{:04}.{suffix}", self.number))
    }
}

/// Name and ending of the files of a series.
fn names(base: &Path) -> (String, String) {
    let text = |part: Option<&std::ffi::OsStr>| part.map(|part| part.to_string_lossy().into_owned());
    (text(base.file_stem()).unwrap_or_default(), text(base.extension()).unwrap_or_else(|| "mcap".into()))
}

/// A file without a name vanishes with the last program that has it open.
fn require_name(file: &File, path: &Path) -> Result<(), WriteError> {
    match file.metadata().map(|about| about.nlink()) {
        Ok(0) => Err(WriteError::Deleted { path: path.to_owned() }),
        _ => Ok(()),
    }
}
