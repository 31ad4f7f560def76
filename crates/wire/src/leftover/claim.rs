//! Names in folders that are open to all users (/tmp, /dev/shm), where anybody may be the first to make a file of any name.
//!
//! Such a name has a number at its end. Programs of one user agree on the number without a place of their own to write it
//! down: it is that of the file which the user already has, or else the lowest that nobody has taken. A stranger who takes
//! names beforehand therefore only makes the number larger.

use crate::sys::uid;
use std::collections::BTreeSet;
use std::fs::{DirBuilder, Metadata};
use std::io::{self, ErrorKind};
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};

/// Tries to make a folder while strangers take the names. They have to be quicker each time.
const TRIES: u32 = 1000;

/// Number of this user's file among those of `folder` whose names `number_in` recognises; the lowest free number if there is none.
/// A file of another kind counts as taken, because a stranger can give a file of this user a second name by a hard link.
pub(crate) fn claimed(
    folder: &Path,
    is_kind: fn(&Metadata) -> bool,
    number_in: impl Fn(&str) -> Option<u32>,
) -> u32 {
    let (user, mut own, mut taken) = (uid(), None, BTreeSet::new());
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let Some(number) = entry.file_name().to_str().and_then(&number_in) else { continue };
        match entry.metadata() {
            Ok(about) if about.uid() == user && is_kind(&about) => {
                own = Some(own.map_or(number, |own: u32| own.min(number)))
            }
            Ok(_) => drop(taken.insert(number)),
            Err(_) => {} // gone
        }
    }
    own.unwrap_or_else(|| (0..).find(|number| !taken.contains(number)).unwrap_or_default())
}

/// The folder `parent/name` of this user alone, which is made if it is missing. Where the name is another user's, a number
/// follows it.
///
/// # Errors
/// The folder cannot be made.
pub fn own_folder(parent: &Path, name: &str) -> io::Result<PathBuf> {
    // A link is not the folder, wherever it leads.
    let is_own = |path: &Path| {
        std::fs::symlink_metadata(path).is_ok_and(|found| found.is_dir() && found.uid() == uid())
    };
    let first = parent.join(name);
    if is_own(&first) {
        return Ok(first);
    }
    for _ in 0..TRIES {
        let number = claimed(parent, Metadata::is_dir, |found| number(found.strip_prefix(name)?));
        let path = parent.join(format!("{name}{}", ending(number)));
        match DirBuilder::new().mode(0o700).create(&path) {
            Ok(()) => return Ok(path),
            Err(error) if error.kind() != ErrorKind::AlreadyExists => return Err(error),
            Err(_) if is_own(&path) => return Ok(path),
            Err(_) => {} // taken since the look
        }
    }
    Err(io::Error::new(ErrorKind::AlreadyExists, format!("{}: other users take all names", first.display())))
}

/// The end of a name with this number: nothing for 0, `-1`, `-2` and so on.
pub(crate) fn ending(number: u32) -> String {
    if number == 0 { String::new() } else { format!("-{number}") }
}

/// Reads what [`ending`] writes.
pub(crate) fn number(text: &str) -> Option<u32> {
    let number = text.strip_prefix('-').map_or(Some(0), |digits| digits.parse().ok())?;
    (ending(number) == text).then_some(number)
}

#[cfg(test)]
#[path = "../../tests/unit/leftover_claim.rs"]
mod tests;
