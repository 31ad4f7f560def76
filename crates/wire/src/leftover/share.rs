//! A domain that a group shares: its folder belongs to the group and has the setgid bit (`install -d -m 2770 -g GROUP FOLDER`).
//!
//! iceoryx2 gives every file to its owner alone. In a shared domain each program gives what it has made to the group, right after it
//! made it and from the thread that watches the domain: only the owner of a file may do that. Files that are not complete yet are
//! left alone, see docs/iceoryx2.md.

use super::places::{Places, name};
use crate::transport::SHM_DIR;
use std::ffi::CString;
use std::fs::Metadata;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// Folders keep their group for what is made in them.
const SET_GROUP: u32 = 0o2000;
/// Descriptions are complete when their owner can no longer write them.
const DESCRIPTIONS: [&str; 4] = [".service", "_tag", ".details", "_context"];

impl Places {
    /// The group that shares the domain.
    pub(crate) fn group(&self) -> Option<u32> {
        let about = std::fs::metadata(&self.root).ok()?;
        (about.mode() & SET_GROUP != 0).then(|| about.gid())
    }

    /// Gives the start lock to the group: it is the first file of a domain, and everybody needs it.
    pub(super) fn share_lock(&self) {
        if let Some(group) = self.group() {
            // SAFETY: the call has no arguments and cannot fail.
            give(&self.lock_path(), group, unsafe { libc::geteuid() });
        }
    }

    /// Gives everything that this user has made to the group, if there is one. What cannot be given stays its owner's.
    pub(crate) fn share(&self) {
        let Some(group) = self.group() else { return };
        // SAFETY: the call has no arguments and cannot fail.
        let user = unsafe { libc::geteuid() };
        share_folder(&self.root, group, user);
        for entry in std::fs::read_dir(SHM_DIR).into_iter().flatten().flatten() {
            if self.own(&entry.file_name().to_string_lossy()).is_some() {
                give(&entry.path(), group, user);
            }
        }
    }
}

/// Everything below a folder; a folder with a group of its own keeps it.
fn share_folder(folder: &Path, group: u32, user: u32) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        let Ok(about) = path.symlink_metadata() else { continue };
        if about.is_dir() {
            let group = if about.mode() & SET_GROUP != 0 { about.gid() } else { group };
            give(&path, group, user);
            share_folder(&path, group, user);
        } else {
            give(&path, group, user);
        }
    }
}

fn give(path: &Path, group: u32, user: u32) {
    let Ok(about) = path.symlink_metadata() else { return };
    if about.uid() != user || about.is_symlink() || !is_complete(path, &about) {
        return;
    }
    let own = about.mode() & 0o7777;
    // The group may do what the owner may.
    let wanted = own | (own & 0o700) >> 3 | if about.is_dir() { SET_GROUP } else { 0 };
    if wanted == own && about.gid() == group {
        return;
    }
    let Ok(path) = CString::new(path.as_os_str().as_bytes()) else { return };
    // SAFETY: the text is terminated and lives across both calls. Links are not followed: a member of the group may have put one
    // in the place of a file. What is refused stays as it is.
    unsafe {
        libc::lchown(path.as_ptr(), libc::uid_t::MAX, group);
        libc::fchmodat(libc::AT_FDCWD, path.as_ptr(), wanted, libc::AT_SYMLINK_NOFOLLOW);
    }
}

/// Whether its maker has finished it: iceoryx2 says so by the last change of a file's permissions.
fn is_complete(path: &Path, about: &Metadata) -> bool {
    let (file, mode) = (name(path), about.mode());
    let is_description = DESCRIPTIONS.iter().any(|ending| file.ends_with(ending));
    if is_description { mode & 0o200 == 0 } else { mode & 0o400 != 0 }
}
