//! Whether a running program's own files are still there.

use crate::leftover::{Places, process_of};
use crate::sys::REMOVED;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Files that a program keeps open while its bus is open. May be sent to another thread.
#[derive(Debug, Clone)]
pub struct OwnFiles {
    places: Places,
    /// Folder of the management files by its real path, as the kernel names open files.
    folder: PathBuf,
}

/// A descriptor that another thread is about to close shows a removed file, too; it is gone after this time.
const SECOND_LOOK: Duration = Duration::from_millis(20);

impl OwnFiles {
    pub(crate) fn new(places: &Places) -> Self {
        let folder = places.root.canonicalize().unwrap_or_else(|_| places.root.clone());
        Self { places: places.clone(), folder }
    }

    /// Removed files of this program, for example by a cleaner of temporary folders. If there are any, no other program finds
    /// this one's topics: it should report them and end, to be restarted.
    ///
    /// Takes about 100 us, and 20 ms more if a file is missing. For calls once a second, not for a real-time thread.
    pub fn removed(&self) -> Vec<PathBuf> {
        let first = self.removed_now();
        if first.is_empty() {
            return Vec::new();
        }
        std::thread::sleep(SECOND_LOOK);
        let second = self.removed_now();
        first.into_iter().filter(|(fd, path)| second.get(fd) == Some(path)).map(|(_, path)| path).collect()
    }

    fn removed_now(&self) -> BTreeMap<PathBuf, PathBuf> {
        let entries = std::fs::read_dir("/proc/self/fd").into_iter().flatten().flatten();
        let links = entries.filter_map(|entry| Some((entry.path(), std::fs::read_link(entry.path()).ok()?)));
        links.filter_map(|(fd, link)| Some((fd, self.removed_file(&link)?))).collect()
    }

    fn removed_file(&self, link: &Path) -> Option<PathBuf> {
        let path = link.to_str()?.strip_suffix(REMOVED)?;
        let ours = Path::new(path).starts_with(&self.folder)
            || path.starts_with(&self.places.writer_locks())
            || self.places.is_own_segment(Path::new(path));
        (ours && !self.is_of_another_program(Path::new(path))).then(|| path.into())
    }

    /// Whether the file describes the node of another program. Such a file is open here as well, and is removed when that program ends.
    fn is_of_another_program(&self, path: &Path) -> bool {
        let entry =
            path.strip_prefix(self.folder.join("nodes")).ok().and_then(|rest| rest.iter().next()?.to_str());
        let id = entry.and_then(|name| self.places.monitor_id(name).or_else(|| name.parse().ok()));
        id.is_some_and(|id| process_of(id) != std::process::id())
    }
}
