//! Removal of what dead programs left in a shared-memory domain.
//!
//! Everything is removed under the exclusive start lock, except incomplete files, whose creators would have them open. Whether a file is
//! in use, the operating system says: it grants a lease on a file only if no other process has it open or mapped.

use super::places::{LOCK_FILE, Places, files, is_counter, name, process_of};
use crate::background_thread;
use crate::now_ns;
use crate::sys::{Ipc, SHM_DIR, uid};
use iceoryx2::node::{DeadNodeView, Node, NodeDetails, NodeState, NodeView};
use iceoryx2::prelude::CallbackProgression;
use std::collections::BTreeSet;
use std::fs::{DirBuilder, File, Metadata, OpenOptions, Permissions};
use std::io::{self, ErrorKind};
use std::ops::AddAssign;
use std::os::fd::AsRawFd;
use std::os::unix::fs::{DirBuilderExt, FileTypeExt, MetadataExt, OpenOptionsExt, PermissionsExt};
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Numbers of removed leftovers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Removed {
    /// Programs (iceoryx2's nodes) that had been killed.
    pub nodes: usize,
    /// Incomplete or ownerless files outside the nodes.
    pub files: usize,
    /// Programs that had been killed and could not be removed.
    pub failed: usize,
}

impl Removed {
    /// Whether anything was removed.
    pub fn any(&self) -> bool {
        self.nodes + self.files > 0
    }
}

impl AddAssign for Removed {
    /// Both together; what could not be removed is counted once.
    fn add_assign(&mut self, later: Self) {
        let Self { nodes, files, failed } = later;
        *self = Self { nodes: self.nodes + nodes, files: self.files + files, failed };
    }
}

/// iceoryx2 removes one node at a time in a process and refuses a second one.
static IN_THIS_PROCESS: Mutex<()> = Mutex::new(());

impl Places {
    /// Removes leftovers of dead programs; waits at most `patience` for programs that create resources. After that only incomplete
    /// files are removed, which needs no lock.
    pub(crate) fn sweep(&self, patience: Duration) -> Removed {
        self.try_sweep(patience).0
    }

    /// As [`Self::sweep`]; the second value is false if others created resources all the time, so that dead programs may be left.
    pub(crate) fn try_sweep(&self, patience: Duration) -> (Removed, bool) {
        // Incomplete files first: the following steps open files and would wait for their completion.
        let mut removed = Removed { files: self.remove_incomplete(), ..Removed::default() };
        let Ok(Some(_lock)) = self.lock_to_remove(patience) else { return (removed, false) };
        let _one_at_a_time = IN_THIS_PROCESS.lock();
        (removed.nodes, removed.failed) = self.remove_dead_nodes();
        removed.files += self.remove_dead_listeners() + self.remove_ownerless();
        (removed, true)
    }

    /// Files that no process has open after the removal of dead nodes are ownerless: each user of a service keeps its description
    /// and its memory open.
    fn remove_ownerless(&self) -> usize {
        let is_socket = |file: &str| {
            self.own(file)
                .and_then(|rest| rest.strip_suffix(".event"))
                .is_some_and(|id| id.parse::<u128>().is_ok())
        };
        let sockets = files(&self.root, is_socket);
        let segments = self.segments().into_iter().filter(|path| !is_counter(path));
        let writers = files(Path::new(SHM_DIR), |file| self.is_writer_lock(file));
        let files = self.service_files().into_iter().chain(segments).chain(sockets).chain(writers);
        files.filter(|path| remove_unused(path)).count() + self.remove_empty_node_folders()
    }
}

// ---- members of the domain (iceoryx2's nodes) ----

/// Bytes of the process identity in a node's context file; zeros are no process.
const NO_PROCESS: [u8; 16] = [0; 16];

/// Time during which files of nodes without a process are polled before they count as in use: a program that reads them may have
/// to wait for its core. Programs of another container, whose processes are invisible here, delay each start by it.
const POLLING: Duration = Duration::from_millis(300);
const BETWEEN_LOOKS: Duration = Duration::from_millis(1);

impl Places {
    /// Removes the dead nodes; returns how many were removed and how many could not be. Only under the exclusive start lock.
    fn remove_dead_nodes(&self) -> (usize, usize) {
        let dead = self.dead_nodes();
        if dead.is_empty() {
            return (0, 0);
        }
        for &id in &dead {
            self.complete(id);
        }
        let mut views = Vec::new();
        // A node that cannot be listed stays; it is counted below.
        let _ = Node::<Ipc>::list(&self.config, |state| {
            if let NodeState::Dead(view) = state {
                views.push(*view.id());
            }
            CallbackProgression::Continue
        });
        for id in views.iter().filter(|id| dead.contains(&id.value())) {
            // The usual call takes the settings from the node's details, which a node that was killed early does
            // not have; it would then clean up iceoryx2's default domain and report success.
            let details = NodeDetails::__internal_new(&None, &self.config);
            let _ = DeadNodeView::<Ipc>::__internal_try_remove_stale_resources(*id, details);
        }
        let left = self.node_ids();
        let failed = dead.iter().filter(|id| left.contains(id)).count();
        (dead.len() - failed, failed)
    }

    /// Nodes with a file: alive, dead, incomplete or partly removed.
    fn node_ids(&self) -> BTreeSet<u128> {
        let monitors = files(&self.nodes(), |name| self.monitor_id(name).is_some());
        let monitored = monitors.iter().filter_map(|path| self.monitor_id(name(path)));
        let folders = files(&self.nodes(), |name| name.parse::<u128>().is_ok());
        let ours = folders.iter().filter(|folder| !files(folder, |file| self.own(file).is_some()).is_empty());
        monitored.chain(ours.filter_map(|folder| name(folder).parse().ok())).collect()
    }

    /// The node to which a file of [`Self::monitor`] belongs.
    pub(crate) fn monitor_id(&self, file: &str) -> Option<u128> {
        self.own(file)?.split_once(".node_monitor")?.0.parse().ok()
    }

    /// A file by which iceoryx2 watches a node: `""` is locked while the node lives, `_owner_lock` while it is removed,
    /// `_context` holds the identity of its process.
    fn monitor(&self, id: u128, part: &str) -> PathBuf {
        self.nodes().join(format!("{}{id}.node_monitor{part}", self.prefix))
    }

    fn node_folder(&self, id: u128) -> PathBuf {
        self.nodes().join(id.to_string())
    }

    /// Unused nodes. Another program that reads the files of a dead node looks like its owner; if no process has the node's number,
    /// the query is repeated.
    fn dead_nodes(&self) -> Vec<u128> {
        let end = Instant::now() + POLLING;
        let (mut undecided, mut dead) = (self.node_ids(), Vec::new());
        loop {
            let (in_use, unused): (BTreeSet<u128>, BTreeSet<u128>) =
                undecided.into_iter().partition(|&id| self.lives(id));
            dead.extend(unused);
            undecided = in_use.into_iter().filter(|&id| !is_process(process_of(id))).collect();
            if undecided.is_empty() || Instant::now() >= end {
                return dead;
            }
            std::thread::sleep(BETWEEN_LOOKS);
        }
    }

    /// A living node has its details and its context file open, one of them from its first moment on. The other two files
    /// must not be opened here: closing them would release the locks that this very process may hold on them.
    fn lives(&self, id: u128) -> bool {
        let details = self.node_folder(id).join(format!("{}node.details", self.prefix));
        is_in_use(&details) || is_in_use(&self.monitor(id, "_context"))
    }

    /// Brings a dead node, killed while it was made or removed, into the state of one that was killed while it ran: that is
    /// the only state that iceoryx2 removes. What cannot be written here fails again, and is counted, when it is removed.
    fn complete(&self, id: u128) {
        for file in files(&self.node_folder(id), |file| self.own(file).is_some()) {
            if std::fs::metadata(&file).is_ok_and(|metadata| service_is_incomplete(&metadata)) {
                let _ = std::fs::remove_file(&file);
            }
        }
        for (part, content, mode) in
            [("", &[][..], 0o600), ("_owner_lock", &[], 0o600), ("_context", &NO_PROCESS, 0o400)]
        {
            let path = self.monitor(id, part);
            let complete =
                |found: Metadata| found.mode() & 0o777 == mode && found.len() >= content.len() as u64;
            if !std::fs::metadata(&path).is_ok_and(complete) {
                let _ = rewrite(&path, content, mode);
            }
        }
    }

    /// Removes folders of nodes that were killed before their first file was made. Such a folder does not say to which domain
    /// it belongs, and nothing in it can be open: a process that lives and carries the folder's number keeps it.
    fn remove_empty_node_folders(&self) -> usize {
        let folders =
            files(&self.nodes(), |name| name.parse::<u128>().is_ok_and(|id| !is_process(process_of(id))));
        // Only empty folders can be removed.
        folders.iter().filter(|folder| std::fs::remove_dir(folder).is_ok()).count()
    }
}

fn is_process(pid: u32) -> bool {
    Path::new("/proc").join(pid.to_string()).exists()
}

fn rewrite(path: &Path, content: &[u8], mode: u32) -> io::Result<()> {
    let _absent_is_fine = std::fs::remove_file(path);
    let mut file = OpenOptions::new().write(true).create_new(true).mode(0o600).open(path)?;
    io::Write::write_all(&mut file, content)?;
    file.set_permissions(Permissions::from_mode(mode))
}

impl Places {
    /// Removes incomplete resources of dead creators; returns their number. Needs no lock: a live creator has the file open from
    /// its creation on.
    pub(crate) fn remove_incomplete(&self) -> usize {
        let segments = self.segments().into_iter().filter(|path| has(path, segment_is_incomplete));
        let services = self.service_files().into_iter().filter(|path| has(path, service_is_incomplete));
        segments.chain(services).filter(|path| remove_unused(path)).count()
    }
}

fn has(path: &Path, property: impl Fn(&Metadata) -> bool) -> bool {
    std::fs::symlink_metadata(path).is_ok_and(|metadata| property(&metadata))
}

/// Shared memory is write-only until it is complete.
fn segment_is_incomplete(metadata: &Metadata) -> bool {
    metadata.len() == 0 || metadata.mode() & 0o400 == 0
}

/// Descriptions are written once and read-only from then on.
fn service_is_incomplete(metadata: &Metadata) -> bool {
    metadata.mode() & 0o200 != 0
}

// ---- shared memory of dead listeners (`.event_mgmt`) ----
//
// iceoryx2 removes the data and the connections of a port whose program was killed while it removed the port, but not the memory of a
// listener. A notifier of another program lets go of it with its next notification only, so that a lease cannot tell it from one in use.

const EVENT: &str = ".event_mgmt";
const PORT_TAG: &str = ".port_tag";

impl Places {
    /// Removes the memory of listeners that have no tag in the folder of any node; returns how many were removed. After the
    /// dead nodes, and only under the exclusive start lock.
    ///
    /// A listener makes its tag before its memory and removes it afterwards: the memory is listed before the tags. Another
    /// shared-memory domain with the same prefix has its tags in another folder: its listeners are recognised by their live processes.
    fn remove_dead_listeners(&self) -> usize {
        let listed: Vec<_> = self
            .segments()
            .into_iter()
            .filter_map(|path| self.listener(name(&path)).map(|id| (path, id)))
            .collect();
        if listed.is_empty() {
            return 0;
        }
        let tagged = self.port_tags();
        let dead = listed.iter().filter(|(_, id)| !tagged.contains(id) && !is_process(process_of(*id)));
        dead.filter(|(path, _)| std::fs::remove_file(path).is_ok()).count()
    }

    /// The listener to which `<prefix><40 hexadecimal digits>_<number>.event_mgmt` belongs.
    fn listener(&self, file: &str) -> Option<u128> {
        self.own(file)?.strip_suffix(EVENT)?.split_once('_')?.1.parse().ok()
    }

    /// The ports of all nodes.
    fn port_tags(&self) -> BTreeSet<u128> {
        let port = |file: &str| self.own(file)?.strip_suffix(PORT_TAG)?.parse::<u128>().ok();
        let nodes = files(&self.nodes(), |file| file.parse::<u128>().is_ok());
        let tags = nodes.iter().flat_map(|node| files(node, |file| port(file).is_some()));
        tags.filter_map(|path| port(name(&path))).collect()
    }
}

// ---- the start lock: shared while a program creates resources, exclusive while leftovers are removed ----

/// Pause between two tries. `flock` itself cannot wait with an end.
const LOCK_PAUSE: Duration = Duration::from_millis(1);

/// A held start lock; given back when dropped.
#[derive(Debug)]
pub(crate) struct StartLock {
    _file: File,
}

impl Places {
    pub(crate) fn lock_path(&self) -> PathBuf {
        self.root.join(LOCK_FILE)
    }

    /// Takes the shared lock. `None` if a program removed leftovers for longer than `patience`.
    ///
    /// # Errors
    /// The folder or the lock file cannot be created.
    pub(crate) fn lock_to_create(&self, patience: Duration) -> io::Result<Option<StartLock>> {
        self.take(libc::LOCK_SH, patience)
    }

    /// Takes the lock alone. `None`: others created something until `patience` was over.
    ///
    /// # Errors
    /// As [`Self::lock_to_create`].
    fn lock_to_remove(&self, patience: Duration) -> io::Result<Option<StartLock>> {
        self.take(libc::LOCK_EX, patience)
    }

    fn take(&self, kind: libc::c_int, patience: Duration) -> io::Result<Option<StartLock>> {
        let end = Instant::now() + patience;
        loop {
            let file = self.open_lock()?;
            // SAFETY: the descriptor is open for the whole call.
            let code = unsafe { libc::flock(file.as_raw_fd(), kind | libc::LOCK_NB) };
            if code == 0 && names_this_file(&self.lock_path(), &file) {
                return Ok(Some(StartLock { _file: file }));
            }
            // The file that was locked may have been removed meanwhile; then the new one counts.
            let error = io::Error::last_os_error();
            if code != 0 && !matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) {
                return Err(error);
            }
            if Instant::now() >= end {
                return Ok(None);
            }
            std::thread::sleep(LOCK_PAUSE);
        }
    }

    fn open_lock(&self) -> io::Result<File> {
        let path = self.lock_path();
        let open = || OpenOptions::new().write(true).create(true).truncate(false).mode(0o600).open(&path);
        open().or_else(|error| {
            if error.kind() != ErrorKind::NotFound {
                return Err(error);
            }
            DirBuilder::new().recursive(true).mode(0o700).create(&self.root)?;
            open()
        })
    }
}

// ---- what keeps a program from joining although nobody holds it ----

/// Ratio of the pause after a search to its duration.
const SEARCH_PAUSE_RATIO: u64 = 20;
/// Beginning of the names of folders that are moved aside.
const ASIDE: &str = "aside-";

impl Places {
    /// Removes files that another user made in the domain's folder, usually root by hand: this user's programs cannot open
    /// them. The folder's owner may remove them, but not what is in a folder of another user, which is moved aside.
    pub(crate) fn remove_files_of_others(&self) {
        let is_ours = |name: &str| self.own(name).is_some() || Places::NAMES.contains(&name);
        remove_files_of_others(&self.root, is_ours);
        for folder in [self.nodes(), self.services()] {
            remove_files_of_others(&folder, |_| true);
        }
    }

    /// Shared memory without a size, for whose growth iceoryx2 would wait indefinitely.
    ///
    /// A program with many topics calls this for each of them. After a search without a result none takes place for [`SEARCH_PAUSE_RATIO`] times
    /// its duration, some hundreds of microseconds in a small domain.
    pub(crate) fn empty_segment(&self) -> Option<PathBuf> {
        let begin_ns = now_ns();
        if begin_ns < self.next_search_ns.load(Ordering::Relaxed) {
            return None;
        }
        let is_empty = |path: &PathBuf| std::fs::symlink_metadata(path).is_ok_and(|about| about.len() == 0);
        let found = self.segments().into_iter().find(is_empty);
        if found.is_none() {
            let end_ns = now_ns();
            self.next_search_ns.store(end_ns + SEARCH_PAUSE_RATIO * (end_ns - begin_ns), Ordering::Relaxed);
        }
        found
    }

    /// Removes a counter that cannot be read. It is made again with the next node; the nodes' numbers stay unique by
    /// their time and process.
    pub(crate) fn remove_damaged_counter(&self) {
        for path in self.counter_segments() {
            remove_unused(&path);
        }
    }

    /// Takes the counter, which iceoryx2 makes open to all users, back to this one. False: it is not there, because another
    /// user took its name at the same moment.
    pub(crate) fn restrict_counter(&self) -> bool {
        let counters = self.counter_segments();
        for path in &counters {
            let file = OpenOptions::new().read(true).custom_flags(libc::O_NOFOLLOW).open(path);
            if let Ok(file) = file {
                let _unchanged_on_errors = file.set_permissions(Permissions::from_mode(0o600));
            }
        }
        !counters.is_empty()
    }
}

fn remove_files_of_others(folder: &Path, is_ours: impl Fn(&str) -> bool) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        let is_foreign = std::fs::symlink_metadata(&path).is_ok_and(|about| about.uid() != uid());
        if !is_foreign || name(&path).starts_with(ASIDE) || !is_ours(name(&path)) {
            continue;
        }
        if std::fs::remove_file(&path).is_err() && std::fs::remove_dir(&path).is_err() {
            // What cannot be moved is named by the first program that cannot open it.
            let _ = std::fs::rename(&path, folder.join(format!("{ASIDE}{}-{}", name(&path), now_ns())));
        }
    }
}

// ---- a thread that removes incomplete shared memory while a bus is open ----
//
// If another program is killed while it creates its connection to one of our ports, iceoryx2 waits in our thread for the completion of
// that connection: a second each time, or indefinitely while the file has no size.

/// Pause between two looks. A look takes some 50 us, longer the more files all users together have in /dev/shm.
const WATCH_PAUSE: Duration = Duration::from_millis(200);
/// Ratio of the pause to the duration of the look before it, at least.
const PAUSE_RATIO: u32 = 20;
/// The thread calls little and keeps little.
const STACK_BYTES: usize = 128 << 10;

/// The running thread; ended when dropped.
#[derive(Debug)]
pub(crate) struct SweepThread {
    stop: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl SweepThread {
    /// Starts to watch `places`. If no thread can be started, other programs still remove incomplete files at their start.
    pub(crate) fn start(places: Places) -> Self {
        let (stop, stopped) = channel::<()>();
        let watch = move || {
            leave_signals_to_others();
            background_thread();
            let mut pause = WATCH_PAUSE;
            while stopped.recv_timeout(pause) == Err(RecvTimeoutError::Timeout) {
                let begin = Instant::now();
                places.remove_incomplete();
                pause = WATCH_PAUSE.max(PAUSE_RATIO * begin.elapsed());
            }
        };
        let thread =
            std::thread::Builder::new().name("domain-watch".into()).stack_size(STACK_BYTES).spawn(watch);
        Self { stop: Some(stop), thread: thread.ok() }
    }
}

impl Drop for SweepThread {
    fn drop(&mut self) {
        self.stop.take();
        if let Some(thread) = self.thread.take() {
            let _a_panic_there_ends_nothing_here = thread.join();
        }
    }
}

/// A program's own threads wait for its signals.
fn leave_signals_to_others() {
    // SAFETY: the set is filled before it is used; the mask is that of this thread only.
    unsafe {
        let mut all: libc::sigset_t = std::mem::zeroed();
        libc::sigfillset(&mut all);
        libc::pthread_sigmask(libc::SIG_SETMASK, &all, std::ptr::null_mut());
    }
}

// ---- whether any process has a file open or mapped ----

/// `fcntl` command for the signal on an open of a leased file (not in the `libc` crate for glibc).
const F_SETSIG: libc::c_int = 10;

/// Removes the file (or socket) at `path` if no process has it open or mapped. Returns whether it was removed.
fn remove_unused(path: &Path) -> bool {
    let Ok(metadata) = std::fs::symlink_metadata(path) else { return false };
    if metadata.file_type().is_socket() {
        return is_dead_socket(path) && std::fs::remove_file(path).is_ok();
    }
    // During the lease no other process has this file open, so none is about to remove it.
    lease(path, &metadata)
        .is_some_and(|file| names_this_file(path, &file) && std::fs::remove_file(path).is_ok())
}

/// Whether some process has the file at `path` open or mapped. A file that is not there is not in use.
fn is_in_use(path: &Path) -> bool {
    std::fs::symlink_metadata(path).is_ok_and(|metadata| lease(path, &metadata).is_none())
}

/// Opens the file if no other process has it open. Later opens wait until the returned file is closed.
///
/// The operating system grants a write lease (`fcntl(2)`, `F_SETLEASE`) only if the file is open nowhere else; a mapping keeps
/// its file open. `None`: the file is in use, or the query failed.
fn lease(path: &Path, metadata: &Metadata) -> Option<File> {
    let readable = metadata.mode() & 0o400 != 0;
    let file = OpenOptions::new()
        .read(readable)
        .write(!readable)
        .custom_flags(libc::O_NOFOLLOW | libc::O_NONBLOCK)
        .open(path)
        .ok()?;
    let fd = file.as_raw_fd();
    // SAFETY: the descriptor is open for both calls, which take a plain number. SIGURG is ignored by default; the usual
    // signal of a lease, SIGIO, would end the process.
    let granted = unsafe {
        libc::fcntl(fd, F_SETSIG, libc::SIGURG) == 0 && libc::fcntl(fd, libc::F_SETLEASE, libc::F_WRLCK) == 0
    };
    granted.then_some(file)
}

/// Whether `path` still names the open `file`, and not a newer one of the same name.
pub(crate) fn names_this_file(path: &Path, file: &File) -> bool {
    match (std::fs::symlink_metadata(path), file.metadata()) {
        (Ok(named), Ok(open)) => (named.dev(), named.ino()) == (open.dev(), open.ino()),
        _ => false,
    }
}

/// True if no process has the datagram socket bound: connections are then refused.
fn is_dead_socket(path: &Path) -> bool {
    let connected = UnixDatagram::unbound().and_then(|socket| socket.connect(path));
    connected.is_err_and(|error| error.kind() == ErrorKind::ConnectionRefused)
}

#[cfg(test)]
#[path = "../../tests/unit/leftover_sweep.rs"]
mod tests;
