//! Names in folders that are open to all users (/tmp, /dev/shm), where anybody may be the first to make a file of any name.
//!
//! Such a name has a number at its end. Programs of one user agree on the number without a place of their own to write it
//! down: it is that of the file which the user already has, or else the lowest that nobody has taken. A stranger who takes
//! names beforehand therefore only makes the number larger.

use crate::sys::uid;
use std::collections::BTreeSet;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// Number of this user's file among those of `folder` whose names `number_in` recognises; the lowest free number if there is none.
pub(crate) fn claimed(folder: &Path, number_in: impl Fn(&str) -> Option<u32>) -> u32 {
    let (mut own, mut taken) = (None, BTreeSet::new());
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let Some(number) = entry.file_name().to_str().and_then(&number_in) else { continue };
        match std::fs::symlink_metadata(entry.path()) {
            Ok(about) if about.uid() == uid() => own = Some(own.map_or(number, |own: u32| own.min(number))),
            Ok(_) => drop(taken.insert(number)),
            Err(_) => {} // gone
        }
    }
    own.unwrap_or_else(|| (0..).find(|number| !taken.contains(number)).unwrap_or_default())
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
