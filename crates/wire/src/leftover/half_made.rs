//! Half-made resources: created, but never completed, because the creator was killed.

use super::places::Places;
use super::unused;
use std::fs::Metadata;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

impl Places {
    /// Removes half-made resources whose creator is dead; returns how many. Needs no lock: a creator that lives has the file
    /// open, from its creation on.
    pub(crate) fn remove_half_made(&self) -> usize {
        let segments = self.segments().into_iter().filter(|path| has(path, segment_is_half_made));
        let services = self.service_files().into_iter().filter(|path| has(path, service_is_half_made));
        segments.chain(services).filter(|path| unused::remove(path)).count()
    }

    /// A shared-memory file of the domain without a size. iceoryx2 waits for ever for such a file to grow.
    pub(crate) fn empty_segment(&self) -> Option<PathBuf> {
        self.segments().into_iter().find(|path| has(path, |metadata| metadata.len() == 0))
    }
}

fn has(path: &Path, property: impl Fn(&Metadata) -> bool) -> bool {
    std::fs::symlink_metadata(path).is_ok_and(|metadata| property(&metadata))
}

/// Shared memory is write-only until it is complete.
fn segment_is_half_made(metadata: &Metadata) -> bool {
    metadata.len() == 0 || metadata.mode() & 0o400 == 0
}

/// Descriptions are written once and read-only from then on.
pub(super) fn service_is_half_made(metadata: &Metadata) -> bool {
    metadata.mode() & 0o200 != 0
}
