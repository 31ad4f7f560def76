//! Ports in an isolated domain: delivery, refusals, late readers, memory.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, SystemTime};
use wire::layout::{field_id, flags, pack_name, unpack_name};
use wire::{
    Bus, Domain, Estimate, EstimateReader, EstimateWriter, FieldHeader, FieldReader, FieldWriter, KeyExpr,
    Payload, SensorReader, SensorSample, SensorWriter, State, StateReader, StateWriter, Topic, Wake, WakeSet,
    Wakeable, Waking, WireError,
};

/// Bus in a separate shared-memory domain, removed on drop.
struct OwnBus(Option<Bus>, Domain);

impl std::ops::Deref for OwnBus {
    type Target = Bus;
    fn deref(&self) -> &Bus {
        self.0.as_ref().unwrap()
    }
}

impl Drop for OwnBus {
    fn drop(&mut self) {
        self.0.take();
        self.1.remove_leftovers().unwrap();
    }
}

fn bus() -> OwnBus {
    let domain = Domain::isolated("ports");
    OwnBus(Some(Bus::open(&domain).unwrap()), domain)
}

fn header(nodes: u32, fields: &[u8]) -> FieldHeader {
    let mut header =
        FieldHeader { node_count: nodes, field_count: fields.len() as u32, ..FieldHeader::default() };
    header.field_ids[..fields.len()].copy_from_slice(fields);
    header
}

#[test]
fn a_field_arrives_where_it_was_written() {
    let bus = bus();
    let topic = Topic::field("finger", None).unwrap();
    let writer = FieldWriter::create(&bus, &topic, 6).unwrap();
    let reader = FieldReader::open(&bus, &topic).unwrap();
    let mut loan = writer.loan().unwrap();
    loan.values_mut().copy_from_slice(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    let sent_ns = loan.send(header(3, &[field_id::X, field_id::VON_MISES])).unwrap();
    let sample = reader.next().unwrap().unwrap();
    assert_eq!(sample.header().t_publish_ns, sent_ns);
    assert_eq!(sample.field(field_id::X).unwrap(), &[1.0, 2.0, 3.0]);
    assert_eq!(sample.field(field_id::VON_MISES).unwrap(), &[4.0, 5.0, 6.0]);
    assert_eq!(sample.field(field_id::Y), None);
    assert!(reader.next().unwrap().is_none());
}

#[test]
fn a_header_that_does_not_describe_the_payload_is_not_sent() {
    let bus = bus();
    let topic = Topic::field("finger", Some("tip")).unwrap();
    let writer = FieldWriter::create(&bus, &topic, 6).unwrap();
    let loan = writer.loan().unwrap();
    let refused = loan.send(header(4, &[field_id::X, field_id::Y]));
    assert!(
        matches!(refused, Err(WireError::FieldShape { found: 6, nodes: 4, fields: 2, .. })),
        "{refused:?}"
    );
}

#[test]
fn a_second_writer_is_refused_with_the_process_of_the_first() {
    let domain = Domain::isolated("second");
    let (first, second) = (Bus::open(&domain).unwrap(), Bus::open(&domain).unwrap());
    let topic = Topic::state("finger").unwrap();
    let held = StateWriter::create(&first, &topic).unwrap();
    let error = StateWriter::create(&second, &topic).unwrap_err();
    let WireError::AlreadyPublished { holder, .. } = &error else { panic!("{error}") };
    assert!(holder.contains(&std::process::id().to_string()), "{error}");
    drop(held);
    drop(StateWriter::create(&second, &topic).expect("the slot is free again"));
    drop((first, second));
    domain.remove_leftovers().unwrap();
}

#[test]
fn a_missing_topic_is_said_and_a_late_reader_gets_the_last_state() {
    let bus = bus();
    let topic = Topic::state("finger").unwrap();
    assert!(matches!(StateReader::open(&bus, &topic), Err(WireError::NoSuchTopic { .. })));
    let mut writer = StateWriter::create(&bus, &topic).unwrap();
    for seq in 1..=3 {
        writer.publish(State { seq, ..State::default() }).unwrap();
    }
    let late = StateReader::open(&bus, &topic).unwrap();
    // History is handed over when the writer next looks at its readers, at the latest with the next sample.
    writer.publish(State { seq: 4, ..State::default() }).unwrap();
    let seqs: Vec<u64> = std::iter::from_fn(|| late.next().unwrap()).map(|state| state.seq).collect();
    assert_eq!(seqs.last(), Some(&4));
}

#[test]
fn a_late_reader_of_a_writer_with_nothing_new_gets_the_last_sample() {
    let bus = bus();
    let topic = Topic::estimate("finger").unwrap();
    let mut writer = EstimateWriter::create(&bus, &topic).unwrap();
    writer.publish(Estimate { seq: 7, ..Estimate::default() }).unwrap();
    let late = EstimateReader::open(&bus, &topic).unwrap();
    assert_eq!(late.newest().unwrap().map(|sample| sample.seq), None, "nothing was sent since");
    writer.serve_late_readers().unwrap();
    assert_eq!(late.newest().unwrap().map(|sample| sample.seq), Some(7));
}

#[test]
fn a_slow_reader_loses_the_oldest_and_the_writer_never_waits() {
    let bus = bus();
    let topic = Topic::field("finger", None).unwrap();
    let writer = FieldWriter::create(&bus, &topic, 4).unwrap();
    let slow = FieldReader::open(&bus, &topic).unwrap();
    let mut held = Vec::new();
    for seq in 1..=200 {
        let mut loan = writer.loan().unwrap();
        loan.values_mut().fill(seq as f32);
        loan.send(FieldHeader { seq, ..header(4, &[field_id::X]) }).unwrap();
        if held.len() < 4 {
            held.push(slow.next().unwrap().unwrap()); // a reader that keeps what it has
        }
    }
    for (sample, seq) in held.iter().zip(1..) {
        assert_eq!(sample.values(), [seq as f32; 4], "a held sample was overwritten");
    }
    drop(held);
    let rest: Vec<u64> =
        std::iter::from_fn(|| slow.next().unwrap()).map(|sample| sample.header().seq).collect();
    assert_eq!(rest, (185..=200).collect::<Vec<u64>>(), "the newest 16 must be waiting, in order");
}

#[test]
fn many_readers_that_hold_all_they_may_leave_a_sample_for_the_writer() {
    let bus = bus();
    let topic = Topic::field("finger", None).unwrap();
    let writer = FieldWriter::create(&bus, &topic, 4).unwrap();
    let readers: Vec<FieldReader> = (0..24).map(|_| FieldReader::open(&bus, &topic).unwrap()).collect();
    assert!(matches!(FieldReader::open(&bus, &topic), Err(WireError::TooManyReaders { limit: 24, .. })));
    let mut held = Vec::new();
    for seq in 1..=400_u64 {
        let loan = writer.loan().unwrap_or_else(|error| panic!("sample {seq}: {error}"));
        loan.send(FieldHeader { seq, ..header(4, &[field_id::X]) }).unwrap();
        // Every reader takes its four samples at another time, so that all 96 are different ones.
        let reader = &readers[(seq % 24) as usize];
        if seq <= 96 {
            held.push(reader.newest().unwrap().unwrap());
        }
    }
    assert_eq!(held.len(), 96);
}

#[test]
fn waits_end_by_event_or_timeout() {
    let bus = bus();
    let topic = Topic::sensor("finger").unwrap();
    let mut writer = SensorWriter::create(&bus, &topic).unwrap();
    let reader = SensorReader::open(&bus, &topic).unwrap();
    let mut wake = WakeSet::new([&reader as &dyn Wakeable]);
    assert_eq!(wake.wait(Duration::from_millis(1)).unwrap(), Wake::Timeout);
    writer.publish(SensorSample { seq: 1, ..SensorSample::default() }).unwrap();
    assert_eq!(wake.wait(Duration::from_secs(10)).unwrap(), Wake::Event);
    assert_eq!(reader.newest().unwrap().map(|sample| sample.seq), Some(1));
    assert_eq!(
        wake.wait(Duration::from_millis(1)).unwrap(),
        Wake::Timeout,
        "a notification that was taken must not wake again"
    );
}

#[test]
fn a_reader_that_is_never_woken_gets_every_sample_and_holds_no_wait_up() {
    let bus = bus();
    let (sensor, field) = (Topic::sensor("finger").unwrap(), Topic::field("finger", None).unwrap());
    let mut writer = SensorWriter::create(&bus, &sensor).unwrap();
    let fields = FieldWriter::create(&bus, &field, 4).unwrap();
    let quiet = SensorReader::attach_as(&bus, &sensor, Waking::Never).unwrap();
    let quiet_field = FieldReader::attach_as(&bus, &field, Waking::Never).unwrap();
    let mut wake = WakeSet::new([&quiet as &dyn Wakeable, &quiet_field]);
    for seq in 1..=3 {
        writer.publish(SensorSample { seq, ..SensorSample::default() }).unwrap();
        let loan = fields.loan().unwrap();
        loan.send(FieldHeader { seq, ..header(4, &[field_id::X]) }).unwrap();
    }
    assert_eq!(wake.wait(Duration::from_millis(1)).unwrap(), Wake::Timeout);
    let seen: Vec<u64> = std::iter::from_fn(|| quiet.next().unwrap()).map(|sample| sample.seq).collect();
    assert_eq!(seen, [1, 2, 3]);
    assert_eq!(quiet_field.newest().unwrap().map(|sample| sample.header().seq), Some(3));
    // Together with a woken one it stays silent, and the other wakes.
    let woken = SensorReader::open(&bus, &sensor).unwrap();
    let mut wake = WakeSet::new([&quiet as &dyn Wakeable, &woken]);
    writer.publish(SensorSample { seq: 4, ..SensorSample::default() }).unwrap();
    assert_eq!(wake.wait(Duration::from_secs(10)).unwrap(), Wake::Event);
    assert_eq!(wake.wait(Duration::from_millis(1)).unwrap(), Wake::Timeout);
}

#[test]
fn topics_are_found_by_key_expression() {
    let bus = bus();
    let _state = StateWriter::create(&bus, &Topic::state("left").unwrap()).unwrap();
    let _sensor = SensorWriter::create(&bus, &Topic::sensor("right").unwrap()).unwrap();
    let field_topic = Topic::field("left", Some("tip")).unwrap();
    let _field = FieldWriter::create(&bus, &field_topic, 3).unwrap();
    let _reader = FieldReader::open(&bus, &field_topic).unwrap();
    let names = |text: &str| -> Vec<String> {
        let key = KeyExpr::new(text).unwrap();
        let found = bus.topics(&key).unwrap().into_iter().map(|info| info.topic);
        let found: Vec<String> = found.map(|topic| topic.to_string()).collect();
        let named = bus.names(&key).unwrap();
        assert!(named.iter().map(Topic::name).eq(&found), "{named:?} and {found:?}");
        found
    };
    assert_eq!(
        names("softtwin/**"),
        ["softtwin/left/field/tip", "softtwin/left/state", "softtwin/right/sensor"]
    );
    assert_eq!(names("softtwin/*/state"), ["softtwin/left/state"]);
    assert!(names("softtwin/absent/**").is_empty());
    let tip = bus.topics(&KeyExpr::new("**/tip").unwrap()).unwrap().remove(0);
    assert_eq!(tip.header_type, FieldHeader::LAYOUT.type_name);
    assert_eq!(
        (tip.writers.as_slice(), tip.readers.as_slice()),
        ([std::process::id()].as_slice(), [std::process::id()].as_slice())
    );
}

/// Writes to the management folder may wait for its disk: listing names must not write.
#[test]
fn listing_names_does_not_write_to_the_folder() {
    let root = tempfile::tempdir().unwrap();
    let domain = Domain { root: Some(root.path().display().to_string()), ..Domain::isolated("names") };
    let (maker, looker) = (Bus::open(&domain).unwrap(), Bus::open(&domain).unwrap());
    let state = StateWriter::create(&maker, &Topic::state("finger").unwrap()).unwrap();
    let field = FieldWriter::create(&maker, &Topic::field("finger", None).unwrap(), 10).unwrap();
    let all = KeyExpr::new("**").unwrap();
    let before = changes(root.path());
    for _ in 0..10 {
        assert_eq!(looker.names(&all).unwrap().len(), 2);
    }
    assert_eq!(changes(root.path()), before);
    assert_eq!(looker.topics(&all).unwrap().len(), 2);
    assert_ne!(changes(root.path()), before, "who opens a topic is noted in the folder");
    drop((state, field, maker, looker));
    domain.remove_leftovers().unwrap();
}

/// Every folder below `root` and when an entry came or went.
fn changes(root: &Path) -> BTreeMap<PathBuf, SystemTime> {
    let mut found = BTreeMap::new();
    let mut folders = vec![root.to_owned()];
    while let Some(folder) = folders.pop() {
        let inside = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap());
        folders.extend(inside.filter(|entry| entry.file_type().unwrap().is_dir()).map(|entry| entry.path()));
        found.insert(folder.clone(), fs::metadata(&folder).unwrap().modified().unwrap());
    }
    found
}

#[test]
fn dropping_everything_leaves_no_shared_memory() {
    let domain = Domain::isolated("leak");
    let bus = Bus::open(&domain).unwrap();
    let topic = Topic::field("finger", None).unwrap();
    let writer = FieldWriter::create(&bus, &topic, 1000).unwrap();
    let reader = FieldReader::open(&bus, &topic).unwrap();
    let mut loan = writer.loan().unwrap();
    loan.values_mut().fill(1.0);
    loan.send(header(1000, &[field_id::X])).unwrap();
    assert!(writer.prefault().unwrap() >= 4000);
    assert!(!files(&domain).is_empty(), "the test looks in the wrong place");
    drop((reader, writer, bus));
    // The management segment remains: one file per shared-memory domain, not per program.
    assert_eq!(files(&domain).len(), 1);
    assert_eq!(domain.remove_leftovers().unwrap(), 1);
    assert_eq!(files(&domain), Vec::<String>::new());
}

fn files(domain: &Domain) -> Vec<String> {
    fs::read_dir("/dev/shm")
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .filter(|name| name.starts_with(&domain.prefix))
        .collect()
}

#[test]
fn topic_names_are_checked_and_read_back() {
    for topic in [
        Topic::sensor("finger").unwrap(),
        Topic::field("finger", None).unwrap(),
        Topic::field("finger", Some("tip")).unwrap(),
        Topic::state("finger-2").unwrap(),
        Topic::health("a_b").unwrap(),
    ] {
        assert_eq!(Topic::parse(topic.name()), Some(topic));
    }
    for bad in ["", "a/b", "*", "a b", "ä", &"x".repeat(32)] {
        assert!(matches!(Topic::state(bad), Err(WireError::BadName { .. })), "{bad}");
    }
    assert_eq!(Topic::parse("softtwin/finger/state/tip"), None);
    let left = Topic::valve("finger").unwrap().of_cavity(Some("left")).unwrap();
    assert_eq!(
        (left.name(), left.cavity(), left.node_set()),
        ("softtwin/finger/valve/left", Some("left"), None)
    );
    assert_eq!(Topic::parse(left.name()), Some(left));
    assert!(Topic::state("finger").unwrap().of_cavity(Some("left")).is_err());
    assert_eq!(Topic::parse("other/finger/state"), None);
    assert_eq!(unpack_name(&pack_name("finger")), "finger");
    assert_eq!(flags::names(flags::STALE | flags::NO_DATA).collect::<Vec<_>>(), ["stale", "no-data"]);
}

/// iceoryx2 sets the process's umask while it binds a listener. In a separate process, in which no other test binds one.
#[test]
fn readers_opened_by_several_threads_leave_the_umask() {
    const OWN_PROCESS: &str = "SOFTTWIN_TEST_UMASK";
    if std::env::var(OWN_PROCESS).is_err() {
        let mut own = Command::new(std::env::current_exe().unwrap());
        own.args(["--exact", "ports::readers_opened_by_several_threads_leave_the_umask"]);
        assert!(own.env(OWN_PROCESS, "1").status().unwrap().success());
        return;
    }
    let umask = || {
        let status = fs::read_to_string("/proc/self/status").unwrap();
        status.lines().find(|line| line.starts_with("Umask:")).unwrap().to_owned()
    };
    let before = umask();
    std::thread::scope(|scope| {
        for _ in 0..8 {
            scope.spawn(|| {
                let bus = bus();
                let topic = Topic::state("finger").unwrap();
                let _writer = StateWriter::create(&bus, &topic).unwrap();
                for _ in 0..100 {
                    StateReader::open(&bus, &topic).unwrap();
                }
            });
        }
    });
    assert_eq!(umask(), before);
}
