//! Shared-memory domain of a group: its folder belongs to the group and has the setgid bit (`install -d -m 3770 -g GROUP FOLDER`).
//!
//! iceoryx2 restricts every file to its owner. For a group each program grants its created files to the group, directly after
//! their creation and from the watching thread: only the owner of a file may do that. Incomplete files are skipped, see
//! docs/iceoryx2.md.

use super::places::{Places, SET_GROUP, is_right, name};
use crate::domain::uid;
use crate::sys::SHM_DIR;
use std::ffi::CString;
use std::fs::Metadata;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// Ending of the samples' memory, which only its publisher writes.
const SAMPLES: &str = ".data";
/// Descriptions are complete when their owner can no longer write them.
const DESCRIPTIONS: [&str; 4] = [".service", "_tag", ".details", "_context"];

impl Places {
    /// Grants the start lock, which is the first file and needed by all programs, to the group.
    pub(super) fn share_lock(&self) {
        if let Some(group) = self.group() {
            grant(&self.lock_path(), group, uid());
        }
    }

    /// Gives everything that this user has made to the group, if there is one. What cannot be given stays its owner's.
    pub(crate) fn share(&self) {
        let Some(group) = self.group() else { return };
        let user = uid();
        share_folder(&self.root, group, user);
        for entry in std::fs::read_dir(SHM_DIR).into_iter().flatten().flatten() {
            if self.own(&entry.file_name().to_string_lossy()).is_some() {
                grant(&entry.path(), group, user);
            }
        }
    }
}

/// Grants everything below a folder; a folder with another group is unchanged.
fn share_folder(folder: &Path, group: u32, user: u32) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        let Ok(about) = path.symlink_metadata() else { continue };
        if about.is_dir() && is_right(&path) {
            continue; // whose group is not the readers'
        }
        if about.is_dir() {
            let group = if about.mode() & SET_GROUP != 0 { about.gid() } else { group };
            grant(&path, group, user);
            share_folder(&path, group, user);
        } else {
            grant(&path, group, user);
        }
    }
}

fn grant(path: &Path, group: u32, user: u32) {
    let Ok(about) = path.symlink_metadata() else { return };
    if about.uid() != user || about.is_symlink() || !is_complete(path, &about) {
        return;
    }
    let own = about.mode() & 0o7777;
    // The group may do what the owner may, except write samples: readers map them read-only.
    let group_bits = if name(path).ends_with(SAMPLES) { own & 0o400 } else { own & 0o700 };
    let wanted = own | group_bits >> 3 | if about.is_dir() { SET_GROUP } else { 0 };
    if wanted == own && about.gid() == group {
        return;
    }
    let Ok(path) = CString::new(path.as_os_str().as_bytes()) else { return };
    // SAFETY: the string is terminated and lives across both calls. Links are not followed: a member of the group may have put one
    // in the place of a file. Errors leave the file unchanged.
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
