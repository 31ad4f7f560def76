//! A blocked scan and a topic that cannot be opened delay no other topic.

use std::collections::BTreeSet;
use std::fs::{self, Permissions};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::{Mutex, mpsc};
use std::thread;
use std::time::{Duration, Instant};

use wire::{Bus, SensorReader, SensorSample, SensorWriter};

use super::*;

/// Limit of every wait.
const PATIENCE: Duration = Duration::from_secs(60);
/// Readings at once: less than a topic keeps for a reader.
const BATCH: u64 = 1_500;

/// A shared-memory domain in a separate folder, with the topic `softtwin/good/sensor`.
struct WorkFolder {
    good: SensorWriter,
    bus: Bus,
    sent: u64,
    domain: Domain,
    _end: Leave,
    folder: tempfile::TempDir,
}

/// Removes the files of the shared-memory domain at the end.
struct Leave(Domain);

impl Drop for Leave {
    fn drop(&mut self) {
        self.0.remove_leftovers().unwrap();
    }
}

impl WorkFolder {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let root = Some(folder.path().join("iox").display().to_string());
        let domain = Domain { root, ..Domain::isolated("recorder") };
        let bus = Bus::open(&domain).unwrap();
        let good = SensorWriter::create(&bus, &topic("good")).unwrap();
        Self { good, bus, sent: 0, _end: Leave(domain.clone()), domain, folder }
    }

    fn options(&self) -> RecorderOptions {
        RecorderOptions {
            keys: vec![KeyExpr::new("softtwin/**").unwrap()],
            with_fields: false,
            path: self.folder.path().join("run.mcap"),
            rotate: RotateOptions::default(),
            queue_bytes: 64 << 20,
        }
    }

    /// Publishes more than a topic keeps, bit by bit, as the recorder takes it.
    fn publish_and_see_all_recorded(&mut self, reported: &Reported) {
        for _ in 0..3 {
            for _ in 0..BATCH {
                self.sent += 1;
                self.good.publish(SensorSample { seq: self.sent, ..SensorSample::default() }).unwrap();
            }
            let sent = self.sent;
            reported.wait("the readings", |summary| {
                summary.messages.get("softtwin/good/sensor") == Some(&sent) && summary.missing == 0
            });
        }
    }

    fn files(&self) -> BTreeSet<PathBuf> {
        let mut found = BTreeSet::new();
        let mut folders = vec![self.folder.path().join("iox")];
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).unwrap().map(Result::unwrap) {
                match entry.file_type().unwrap().is_dir() {
                    true => folders.push(entry.path()),
                    false => _ = found.insert(entry.path()),
                }
            }
        }
        found
    }
}

fn topic(actuator: &str) -> Topic {
    Topic::sensor(actuator).unwrap()
}

/// The newest summary that the recorder reported.
#[derive(Default)]
struct Reported(Mutex<RecordSummary>);

impl Reported {
    fn wait(&self, what: &str, is_so: impl Fn(&RecordSummary) -> bool) {
        let end = Instant::now() + PATIENCE;
        loop {
            let summary = self.0.lock().unwrap().clone();
            if is_so(&summary) {
                return;
            }
            assert!(Instant::now() < end, "{what}: {summary:?}");
            thread::sleep(Duration::from_millis(2));
        }
    }
}

/// Runs `recorder` while `body` runs, and finishes it.
fn while_recording(mut recorder: Recorder, body: impl FnOnce(&Reported)) -> RecordSummary {
    let (reported, stop) = (Reported::default(), AtomicBool::new(false));
    thread::scope(|scope| {
        let running = scope.spawn(|| {
            recorder.run(&stop, |_, summary| reported.0.lock().unwrap().clone_from(summary)).unwrap();
            recorder
        });
        let ending = End(&stop);
        body(&reported);
        drop(ending);
        running.join().unwrap().finish().unwrap()
    })
}

/// Ends the recording, also after a panic.
struct End<'a>(&'a AtomicBool);

impl Drop for End<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// The folder of the shared-memory domain is on a blocked disk.
#[test]
fn a_scan_that_hangs_delays_no_reading() {
    let mut place = WorkFolder::new();
    let (release, held) = mpsc::channel::<()>();
    let recorder = Recorder::start_with(&place.domain, place.options(), || {
        let mut is_first = true;
        move || {
            if !std::mem::take(&mut is_first) {
                assert!(held.recv().is_err(), "nothing is ever sent");
            }
            Ok(vec![topic("good")])
        }
    });
    let summary = while_recording(recorder.unwrap(), |reported| {
        place.publish_and_see_all_recorded(reported);
        drop(release);
    });
    assert_eq!((summary.missing, summary.dropped, summary.files.messages), (0, 0, place.sent));
}

/// A topic that hangs in its creation, as a killed program leaves it: reported, tried again, recorded once it can be.
#[test]
fn a_topic_that_cannot_be_opened_delays_no_other() {
    let mut place = WorkFolder::new();
    let before = place.files();
    let mut writer = SensorWriter::create(&place.bus, &topic("hung")).unwrap();
    let made: Vec<PathBuf> =
        place.files().difference(&before).filter(|path| is_service(path)).cloned().collect();
    assert!(!made.is_empty(), "the topic's files: {:?}", place.files());
    let set_mode =
        |mode| made.iter().for_each(|path| fs::set_permissions(path, Permissions::from_mode(mode)).unwrap());
    let mode = fs::metadata(&made[0]).unwrap().permissions().mode();
    // The rights that a file of the folder has until its maker is done with it.
    set_mode(0o600);
    let (show, shown) = mpsc::channel::<Vec<Topic>>();
    show.send(vec![topic("good")]).unwrap();
    let recorder = Recorder::start_with(&place.domain, place.options(), || {
        move || Ok(shown.try_recv().unwrap_or_default())
    });
    let summary = while_recording(recorder.unwrap(), |reported| {
        show.send(vec![topic("hung")]).unwrap();
        place.publish_and_see_all_recorded(reported);
        reported.wait("the error", |summary| summary.errors.contains_key("softtwin/hung/sensor"));
        place.publish_and_see_all_recorded(reported);
        set_mode(mode);
        reported.wait("the end of the error", |summary| summary.errors.is_empty());
        writer.publish(SensorSample { seq: 1, ..SensorSample::default() }).unwrap();
        reported.wait("its reading", |summary| summary.messages.get("softtwin/hung/sensor") == Some(&1));
    });
    assert_eq!((summary.missing, summary.dropped, summary.files.messages), (0, 0, place.sent + 1));
    assert!(summary.errors.is_empty());
}

fn is_service(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "service")
}

/// At the start, what cannot be read ends the recording; later it is reported and tried again.
#[test]
fn a_refused_topic_is_an_error_at_the_start_and_reported_later() {
    let mut place = WorkFolder::new();
    let full = topic("full");
    let mut readers: Vec<SensorReader> = (0..wire::qos::of(TopicKind::Sensor).max_readers)
        .map(|_| SensorReader::attach(&place.bus, &full).unwrap())
        .collect();
    let refused = Recorder::start(&place.domain, place.options()).err();
    assert!(matches!(refused, Some(RecordError::Wire(WireError::TooManyReaders { .. }))), "{refused:?}");

    let (show, shown) = mpsc::channel::<Vec<Topic>>();
    show.send(vec![topic("good")]).unwrap();
    // The same file again: the first try left none.
    let recorder = Recorder::start_with(&place.domain, place.options(), || {
        move || Ok(shown.try_recv().unwrap_or_default())
    });
    let summary = while_recording(recorder.unwrap(), |reported| {
        show.send(vec![full.clone()]).unwrap();
        reported.wait("the error", |summary| summary.errors.contains_key(full.name()));
        place.publish_and_see_all_recorded(reported);
        readers.pop();
        reported.wait("the end of the error", |summary| summary.errors.is_empty());
    });
    assert_eq!((summary.missing, summary.dropped, summary.files.messages), (0, 0, place.sent));
}

/// A folder that cannot be read is reported until it can be read again; known topics are recorded meanwhile.
#[test]
fn a_failed_scan_is_reported_until_one_succeeds() {
    let mut place = WorkFolder::new();
    let (show, shown) = mpsc::channel::<ScanResult>();
    show.send(Ok(vec![topic("good")])).unwrap();
    let recorder = Recorder::start_with(&place.domain, place.options(), || {
        // Between the answers of the test nothing changes: a scan that waits.
        move || shown.recv().unwrap_or_else(|_| Ok(Vec::new()))
    });
    let summary = while_recording(recorder.unwrap(), |reported| {
        show.send(Err(WireError::List { cause: "no such folder".into() })).unwrap();
        reported.wait("the error", |summary| {
            summary.errors.get("topics").is_some_and(|why| why.contains("no such folder"))
        });
        place.publish_and_see_all_recorded(reported);
        drop(show);
        reported.wait("the end of the error", |summary| summary.errors.is_empty());
    });
    assert_eq!((summary.missing, summary.files.messages), (0, place.sent));
}

/// A topic of another version is reported and skipped, at the start and later.
#[test]
fn a_topic_of_another_layout_is_skipped_and_the_others_are_recorded() {
    let mut place = WorkFolder::new();
    let foreign = |actuator| {
        let topic = Topic::state(actuator).unwrap();
        let writer = SensorWriter::create(&place.bus, &topic).unwrap();
        (topic.name().to_owned(), writer)
    };
    let (early, _early) = foreign("early");
    let recorder = Recorder::start(&place.domain, place.options()).unwrap();
    let (late, _late) = foreign("late");
    let summary = while_recording(recorder, |reported| {
        place.publish_and_see_all_recorded(reported);
        reported.wait("both", |summary| summary.skipped.contains_key(&late));
    });
    assert_eq!(summary.skipped.keys().collect::<Vec<_>>(), [&early, &late]);
    assert_eq!((summary.missing, summary.files.messages), (0, place.sent));
    assert!(summary.errors.is_empty());
}

/// A recorder without its scan would miss new topics: it ends and names the thread.
#[test]
fn a_thread_that_panics_ends_the_recording() {
    let place = WorkFolder::new();
    let mut scans = 0;
    let recorder = Recorder::start_with(&place.domain, place.options(), move || {
        move || {
            scans += 1;
            assert!(scans < 2, "scan {scans}");
            Ok(Vec::new())
        }
    });
    let mut recorder = recorder.unwrap();
    let error = recorder.run(&AtomicBool::new(false), |_, _| {}).unwrap_err();
    let RecordError::Thread(ended) = &error else { panic!("{error}") };
    assert!(ended.thread == "topic scan" && ended.cause.contains("scan 2"), "{error}");
    recorder.finish().unwrap();
}
