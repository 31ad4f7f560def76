//! Check of who published a sample. In a shared domain the right to publish is a folder (`writer_lock.rs`); a program that does not
//! ask for it is ignored by the readers.

use crate::leftover::Places;
use crate::{Topic, sys};
use std::cell::Cell;
use std::os::unix::fs::MetadataExt;
use std::path::PathBuf;

/// Publishers whose samples a reader takes: those of root, of the folder's owner, and of the user who holds the topic's lock.
#[derive(Debug)]
pub(crate) struct Origins {
    topic: String,
    /// Empty in a private domain, which other users cannot enter.
    shared: Option<Shared>,
}

#[derive(Debug)]
struct Shared {
    root: PathBuf,
    /// The topic's lock, in the folder that gives the right to publish it.
    lock: PathBuf,
    /// The publisher of the last sample, and whether its samples are taken.
    known: Cell<Option<(u128, bool)>>,
    /// User of the last report.
    reported: Cell<Option<u32>>,
}

impl Origins {
    pub(crate) fn new(places: &Places, topic: &Topic) -> Self {
        let shared = places.group().map(|_| Shared {
            root: places.root.clone(),
            lock: places.writer_lock(topic.name()),
            known: Cell::new(None),
            reported: Cell::new(None),
        });
        Self { topic: topic.name().to_owned(), shared }
    }

    /// Whether samples of this publisher are taken. The operating system is asked once per publisher; a refused user is logged once.
    pub(crate) fn allow(&self, publisher: u128) -> bool {
        let Some(shared) = &self.shared else { return true };
        if let Some((_, allowed)) = shared.known.get().filter(|(known, _)| *known == publisher) {
            return allowed;
        }
        // Memory of a fixed size, and memory that grows (answers): `_<number>__0.data`.
        let (fixed, growing) = (format!("_{publisher}.data"), format!("_{publisher}__"));
        let user = sys::owner_of_open_file(|path| path.ends_with(&fixed) || path.contains(&growing));
        let allowed = user.is_some_and(|user| shared.may_publish(user));
        shared.known.set(Some((publisher, allowed)));
        if !allowed && shared.reported.replace(user) != user {
            let user = user.map_or_else(|| "unknown".to_owned(), |user| user.to_string());
            let folder = shared.lock.parent().unwrap_or(&shared.root).display();
            tracing::warn!(
                "{}: samples of user {user} are ignored: only users who may write in {folder} publish this",
                self.topic
            );
        }
        allowed
    }
}

impl Shared {
    /// The owner of a file is the user who made it: only root can give a file away.
    fn may_publish(&self, user: u32) -> bool {
        let owner = |path: &std::path::Path| std::fs::symlink_metadata(path).ok().map(|about| about.uid());
        let Some(domain) = owner(&self.root) else { return false };
        let is_right = self.lock.parent().and_then(owner).is_some_and(|right| right == 0 || right == domain);
        user == 0 || user == domain || is_right && owner(&self.lock) == Some(user)
    }
}
