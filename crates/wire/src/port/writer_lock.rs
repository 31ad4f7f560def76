//! One lock file per written topic, in /dev/shm: it refuses a second writer even if the management folder was emptied and
//! iceoryx2 no longer knows the first one.

use super::retry::Refusal;
use crate::WireError;
use crate::leftover::{Places, names_this_file};
use crate::sys::open_or_make;
use std::fs::{DirBuilder, File, OpenOptions, Permissions};
use std::io::{ErrorKind, Read, Write};
use std::os::fd::AsRawFd;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

/// The right to write a topic. Given back when dropped; the kernel takes it back from a program that is killed.
#[derive(Debug)]
pub(crate) struct WriterLock {
    path: PathBuf,
    file: File,
}

impl WriterLock {
    /// Takes the right to write `topic`; `owner` is who does, for the message to a second writer, or empty.
    pub(crate) fn take(places: &Places, topic: &str, owner: &str) -> Result<Self, Refusal> {
        let path = places.writer_lock(topic);
        let refused = |error: std::io::Error| {
            let cause = format!("{}: {error}", path.display());
            Refusal::Final(WireError::Open { topic: topic.to_owned(), cause })
        };
        let right = places.right_to_write(topic);
        let folder =
            right.as_deref().map(|folder| open_folder(places, folder)).transpose().map_err(refused)?;
        let mut options = OpenOptions::new();
        options.read(true).write(true).custom_flags(libc::O_NOFOLLOW).mode(0o600);
        let mut file = open_or_make(&options, &path).map_err(|error| match (error.kind(), &right) {
            (ErrorKind::PermissionDenied, None) => refused(taken(&path, &error)),
            (ErrorKind::PermissionDenied, Some(folder)) => refused(std::io::Error::new(
                error.kind(),
                format!("{error}; only users who may write in {} publish this", folder.display()),
            )),
            _ => refused(error),
        })?;
        // What counts is the file that is open: a folder may have been put in the place of the one that was checked.
        match &folder {
            Some(folder) if !names_this_file(&in_folder(folder, &path), &file) => {
                return Err(Refusal::Passing(format!("{} was replaced at the same time", path.display())));
            }
            // The folder's group takes the lock of a killed writer over.
            Some(_) => drop(file.set_permissions(Permissions::from_mode(0o660))),
            None => {
                let owner = file.metadata().map_err(refused)?.uid();
                let domain = std::fs::metadata(&places.root).map_err(refused)?.uid();
                if !is_trusted(owner, crate::domain::uid()) && owner != domain {
                    // Only root may remove it from /dev/shm.
                    return Err(match std::fs::remove_file(&path) {
                        Ok(()) => Refusal::Passing(format!("{} was another user's", path.display())),
                        Err(_) => refused(taken(&path, &ErrorKind::PermissionDenied.into())),
                    });
                }
            }
        }
        // SAFETY: the descriptor is open for the whole call.
        if unsafe { libc::flock(file.as_raw_fd(), libc::LOCK_EX | libc::LOCK_NB) } != 0 {
            let error = std::io::Error::last_os_error();
            return Err(match error.kind() {
                ErrorKind::WouldBlock => Refusal::Final(already_published(topic, &mut file)),
                _ => refused(error),
            });
        }
        if !names_this_file(&path, &file) {
            return Err(Refusal::Passing(format!("{} was removed at the same time", path.display())));
        }
        // Readers take the samples of the lock's owner: the lock that another user's killed program left is made again.
        let is_own = file.metadata().map_err(refused)?.uid() == crate::domain::uid();
        if right.is_some() && !is_own {
            std::fs::remove_file(&path).map_err(refused)?;
            return Err(Refusal::Passing(format!("{} was another user's", path.display())));
        }
        // Number and name only help a reader of the message; the lock is what counts.
        let _ = file.set_len(0).and_then(|()| writeln!(file, "{} {owner}", std::process::id()));
        Ok(Self { path, file })
    }
}

/// Whether a file of `owner` has been made by root or by `user`.
fn is_trusted(owner: u32, user: u32) -> bool {
    owner == 0 || owner == user
}

/// Opens the folder that gives the right to write, which must be root's or the root folder's owner's. Where it is missing, that
/// owner makes it for itself alone.
fn open_folder(places: &Places, path: &Path) -> std::io::Result<File> {
    let owner = std::fs::metadata(&places.root)?.uid();
    if is_trusted(crate::domain::uid(), owner) {
        let made = DirBuilder::new().mode(0o700).create(path);
        if made.is_ok() {
            std::os::unix::fs::chown(path, Some(owner), None)?;
        }
    }
    let flags = libc::O_PATH | libc::O_DIRECTORY | libc::O_NOFOLLOW;
    let folder = OpenOptions::new().read(true).custom_flags(flags).open(path)?;
    let found = folder.metadata()?.uid();
    if is_trusted(found, owner) {
        return Ok(folder);
    }
    let why = format!(
        "Permission denied; {} belongs to user {found}, expected user {owner} or root: remove it",
        path.display()
    );
    Err(std::io::Error::new(ErrorKind::PermissionDenied, why))
}

/// Path of a file by its open folder.
fn in_folder(folder: &File, path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default();
    Path::new("/proc/self/fd").join(folder.as_raw_fd().to_string()).join(name)
}

/// A lock of a private domain that another user's file keeps from being made.
fn taken(path: &Path, error: &std::io::Error) -> std::io::Error {
    let owner = std::fs::symlink_metadata(path)
        .map_or_else(|_| "another user".into(), |about| format!("user {}", about.uid()));
    let why = format!("{error}; the file belongs to {owner}: remove it as that user or as root");
    std::io::Error::new(ErrorKind::PermissionDenied, why)
}

impl Drop for WriterLock {
    fn drop(&mut self) {
        if names_this_file(&self.path, &self.file) {
            let _gone_is_fine = std::fs::remove_file(&self.path);
        }
    }
}

fn already_published(topic: &str, file: &mut File) -> WireError {
    let mut text = String::new();
    let _unreadable_is_unnamed = file.read_to_string(&mut text);
    let (number, owner) = text.trim().split_once(' ').unwrap_or((text.trim(), ""));
    let named = if owner.is_empty() { String::new() } else { format!("`{owner}`, ") };
    let holder = number.parse::<u32>().map(|pid| format!(" ({named}process {pid})")).unwrap_or_default();
    WireError::AlreadyPublished { topic: topic.to_owned(), holder }
}
