//! Leftover files of dead programs in a shared-memory domain, and exhausted resources.

use std::fs::{File, Permissions};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use wire::{
    Bus, Domain, KeyExpr, OwnFiles, QueryClient, QueryServer, State, StateReader, StateWriter, Topic,
    WireError, qos,
};

/// Shared-memory domain in a separate folder.
struct WorkFolder {
    folder: tempfile::TempDir,
    domain: Domain,
}

impl WorkFolder {
    fn new(label: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let root = Some(folder.path().join("iox").display().to_string());
        Self { domain: Domain { root, ..Domain::isolated(label) }, folder }
    }

    fn root(&self) -> PathBuf {
        self.folder.path().join("iox")
    }

    /// Names of the files in shared memory.
    fn shared(&self) -> Vec<String> {
        let names = std::fs::read_dir("/dev/shm").unwrap();
        let names = names.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned());
        names.filter(|name| name.starts_with(&self.domain.prefix)).collect()
    }

    /// Makes a file as iceoryx2 begins it: without read permission, without a size.
    fn incomplete(&self, name: &str) -> (PathBuf, File) {
        let path = Path::new("/dev/shm").join(format!("{}{name}", self.domain.prefix));
        let file = File::create_new(&path).unwrap();
        std::fs::set_permissions(&path, Permissions::from_mode(0o200)).unwrap();
        (path, file)
    }
}

impl Drop for WorkFolder {
    fn drop(&mut self) {
        for name in self.shared() {
            std::fs::remove_file(Path::new("/dev/shm").join(name)).unwrap();
        }
    }
}

/// Time after which a test fails.
const PATIENCE: Duration = Duration::from_secs(60);
const TYPE: &str = "9204dd183d1c4d8e1ff592a30766ffa6765aa8b5";

fn topic() -> Topic {
    Topic::state("finger").unwrap()
}

/// The name contains a hash of a type, so it is read from a working shared-memory domain.
#[test]
fn incomplete_counter_of_a_dead_program_is_removed_at_the_next_start() {
    let place = WorkFolder::new("counter");
    drop(Bus::open(&place.domain).unwrap());
    let counter = place.shared().pop().unwrap();
    let path = Path::new("/dev/shm").join(&counter);
    for (size, mode) in [(0, 0o200), (4096, 0o200), (0, 0o666)] {
        std::fs::remove_file(&path).unwrap();
        let file = File::create_new(&path).unwrap();
        file.set_len(size).unwrap();
        file.set_permissions(Permissions::from_mode(mode)).unwrap();
        drop(file);
        let bus = Bus::open(&place.domain).unwrap();
        assert!(bus.removed().files >= 1, "{:?}", bus.removed());
    }
}

#[test]
fn incomplete_description_is_removed_unless_its_creator_lives() {
    let place = WorkFolder::new("description");
    let bus = Bus::open(&place.domain).unwrap();
    drop(StateWriter::create(&bus, &topic()).unwrap());
    let services = place.root().join("services");
    let path = services.join(format!("{}{TYPE}.service", place.domain.prefix));
    let file = File::create_new(&path).unwrap();
    file.set_permissions(Permissions::from_mode(0o600)).unwrap();
    bus.clean_up(Duration::from_secs(1));
    assert!(path.exists(), "its creator lives: this test has it open");
    drop(file);
    assert_eq!(bus.clean_up(Duration::from_secs(1)).files, 1);
    assert!(!path.exists());
}

/// iceoryx2 alone would wait indefinitely.
#[test]
fn file_without_a_size_in_use_is_named_within_a_limit() {
    let place = WorkFolder::new("empty");
    let bus = Bus::open(&place.domain).unwrap();
    let (path, file) = place.incomplete(&format!("{TYPE}_1.dynamic"));
    let refused = StateWriter::create(&bus, &topic()).unwrap_err();
    let WireError::InFlux { cause, .. } = &refused else { panic!("{refused}") };
    assert!(cause.contains(path.to_str().unwrap()), "{refused}");
    drop(file);
    StateWriter::create(&bus, &topic()).unwrap();
}

/// A notifier keeps the memory of a listener that is dead until its next notification.
#[test]
fn a_dead_listeners_memory_is_removed_though_others_have_it_mapped_and_a_living_ones_stays() {
    let place = WorkFolder::new("listener");
    let bus = Bus::open(&place.domain).unwrap();
    let (dead, living) = (dead_process(), std::process::id());
    let memory = |process: u32| {
        let path = format!("/dev/shm/{}{TYPE}_{}.event_mgmt", place.domain.prefix, port_of(process));
        let file = File::create_new(&path).unwrap();
        file.set_len(4096).unwrap();
        (PathBuf::from(path), file)
    };
    let ((of_dead, _open), (of_living, _too)) = (memory(dead), memory(living));
    let node =
        std::fs::read_dir(place.root().join("nodes")).unwrap().flatten().find(|e| e.path().is_dir()).unwrap();
    let tag = node.path().join(format!("{}{}.port_tag", place.domain.prefix, port_of(dead)));
    File::create_new(&tag).unwrap();
    assert_eq!(bus.clean_up(Duration::from_secs(1)).files, 0, "a live node has the port");
    std::fs::remove_file(&tag).unwrap();
    assert_eq!(bus.clean_up(Duration::from_secs(1)).files, 1);
    assert!(!of_dead.exists() && of_living.exists());
}

/// A program that lists nodes opens the files of dead ones for a moment and then looks like their owner.
#[test]
fn a_dead_node_whose_files_another_program_just_reads_is_removed_all_the_same() {
    let place = WorkFolder::new("looked-at");
    let bus = Bus::open(&place.domain).unwrap();
    let node = port_of(dead_process()); // nodes are numbered as ports are
    let path = place.root().join("nodes").join(format!("{}{node}.node_monitor_context", place.domain.prefix));
    std::fs::write(&path, [0; 16]).unwrap();
    std::fs::set_permissions(&path, Permissions::from_mode(0o400)).unwrap();
    let reading = File::open(&path).unwrap();
    let removed = bus.clean_up(Duration::from_secs(1));
    assert!(removed.nodes == 0 && path.exists(), "a process has it open all the time: {removed:?}");
    let (begun, begins) = std::sync::mpsc::channel();
    let reader = std::thread::spawn(move || {
        begun.send(()).unwrap();
        std::thread::sleep(Duration::from_millis(100)); // how long it reads, on a busy machine
        drop(reading);
    });
    begins.recv().unwrap();
    assert_eq!(bus.clean_up(Duration::from_secs(1)).nodes, 1);
    assert!(!path.exists());
    reader.join().unwrap();
}

/// A port's number, as iceoryx2 forms it: counter, process, time, each of 32 bits or two times 32.
fn port_of(process: u32) -> u128 {
    (1 << 96) | (u128::from(process) << 64) | 7
}

/// The number of a process that has ended.
fn dead_process() -> u32 {
    let mut child = std::process::Command::new("true").spawn().unwrap();
    child.wait().unwrap();
    child.id()
}

/// The thread of every bus does so, whatever the program itself is waiting for.
#[test]
fn running_program_removes_incomplete_files_of_others() {
    let place = WorkFolder::new("watch");
    let _bus = Bus::open(&place.domain).unwrap();
    let (path, file) = place.incomplete(&format!("{TYPE}_1_2.connection"));
    drop(file);
    let begin = Instant::now();
    while path.exists() {
        assert!(begin.elapsed() < PATIENCE, "{} stays", path.display());
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// A thread that leaves the shared-memory domain removes its files, which other threads of the program have open as well.
#[test]
fn files_of_a_thread_that_has_left_are_not_missed() {
    let place = WorkFolder::new("threads");
    let files = OwnFiles::of(&place.domain).unwrap();
    let [first, second] = [(); 2].map(|()| Bus::open(&place.domain).unwrap());
    let _writer = StateWriter::create(&first, &topic()).unwrap();
    let reader = StateReader::open(&second, &topic()).unwrap();
    assert_eq!(first.topics(&KeyExpr::new("softtwin/**").unwrap()).unwrap()[0].readers.len(), 1);
    drop((reader, second));
    assert_eq!(files.removed(), Vec::<PathBuf>::new());
    std::fs::remove_dir_all(place.root().join("nodes")).unwrap();
    assert!(!files.removed().is_empty());
}

#[test]
fn an_emptied_folder_is_noticed_and_admits_no_second_writer() {
    let place = WorkFolder::new("emptied");
    let bus = Bus::open(&place.domain).unwrap();
    let mut writer = StateWriter::create(&bus, &topic()).unwrap();
    let files = OwnFiles::of(&place.domain).unwrap();
    assert_eq!(files.removed(), Vec::<PathBuf>::new());
    std::fs::remove_dir_all(place.root()).unwrap();
    assert!(
        files.removed().iter().any(|path| path.ends_with("iox/services") || path.starts_with(place.root()))
    );
    let second = Bus::open(&place.domain).unwrap();
    let refused = StateWriter::create(&second, &topic()).unwrap_err();
    let own = format!("(process {})", std::process::id());
    assert!(
        matches!(&refused, WireError::AlreadyPublished { holder, .. } if holder.contains(&own)),
        "{refused}"
    );
    writer.publish(State::default()).unwrap();
    drop(writer);
    StateWriter::create(&second, &topic()).unwrap();
}

/// Another actuator's folder of the same prefix is another domain.
#[test]
fn a_writer_is_alone_in_its_own_domain_only() {
    let (one, other) = (WorkFolder::new("one"), WorkFolder::new("other"));
    let same_prefix = Domain { root: other.domain.root.clone(), ..one.domain.clone() };
    let (first, second) = (Bus::open(&one.domain).unwrap(), Bus::open(&same_prefix).unwrap());
    let _writer = StateWriter::create(&first, &topic()).unwrap();
    StateWriter::create(&second, &topic()).unwrap();
}

#[test]
fn full_places_are_called_so() {
    let place = WorkFolder::new("full");
    let bus = Bus::open(&place.domain).unwrap();
    let _server = QueryServer::create(&bus, "finger").unwrap();
    let clients: Vec<_> = (0..qos::MAX_CLIENTS).map(|_| QueryClient::open(&bus, "finger").unwrap()).collect();
    let refused = QueryClient::open(&bus, "finger").unwrap_err();
    assert!(matches!(refused, WireError::TooManyClients { limit: qos::MAX_CLIENTS, .. }), "{refused}");
    drop(clients);
    QueryClient::open(&bus, "finger").unwrap();
    let _writer = StateWriter::create(&bus, &topic()).unwrap();
    let readers: Vec<_> = (0..64).map(|_| StateReader::open(&bus, &topic()).unwrap()).collect();
    let refused = StateReader::open(&bus, &topic()).unwrap_err();
    assert!(matches!(refused, WireError::TooManyReaders { limit: 64, .. }), "{refused}");
    drop(readers);
}

/// A full domain refuses new topics at once; those that exist are written again.
#[test]
fn domain_with_the_largest_number_of_topics_refuses_another_one() {
    let place = WorkFolder::new("full");
    let bus = Bus::open(&place.domain).unwrap();
    let writer = StateWriter::create(&bus, &topic()).unwrap();
    let reader = StateReader::open(&bus, &topic()).unwrap();
    for number in 0..2 * qos::MAX_TOPICS {
        let file = format!("{}{number:040x}.service", place.domain.prefix);
        let path = place.root().join("services").join(file);
        std::fs::write(&path, "").unwrap();
        std::fs::set_permissions(&path, Permissions::from_mode(0o400)).unwrap();
    }
    let refused = StateWriter::create(&bus, &Topic::state("another").unwrap()).unwrap_err();
    assert!(matches!(refused, WireError::TooManyTopics { limit: qos::MAX_TOPICS, .. }), "{refused}");
    drop(writer);
    StateWriter::create(&bus, &topic()).unwrap();
    drop(reader);
}
