//! Moves the samples of one topic to the queue, on a dedicated thread: opening a topic writes to the folder of the shared-memory
//! domain, and a busy disk must not delay the other topics.

use std::sync::mpsc::Sender;
use std::time::Duration;

use wire::{AnyReader, Bus, Domain, WakeSet, Wakeable, Waking, WireError, now_ns};

use super::queue::QueueSink;
use wire::thread_group::{StopFlag, WAIT};

/// Pause before a topic that cannot be read is tried again.
const RETRY: Duration = Duration::from_secs(1);

/// Whether a topic could be opened.
pub type Opened = Result<(), WireError>;

/// Moves everything of a topic into `sink`, and opens it again when it breaks. The result of each try goes to `opened`.
pub fn keep_moving(domain: &Domain, mut sink: QueueSink, opened: &Sender<Opened>, stop: &StopFlag) {
    while !stop.is_set() {
        if let Err(error) = open_and_move(domain, &mut sink, opened, stop) {
            sink.set_error(Some(&error));
            report(opened, Err(error));
            stop.pause(RETRY);
        }
    }
}

/// Returns when `stop` is set, or when the topic cannot be opened or breaks.
fn open_and_move(
    domain: &Domain,
    sink: &mut QueueSink,
    opened: &Sender<Opened>,
    stop: &StopFlag,
) -> Result<(), WireError> {
    let bus = Bus::open(domain)?;
    let reader = AnyReader::attach_as(&bus, sink.topic(), Waking::ByEvent)?;
    sink.set_error(None);
    report(opened, Ok(()));
    let mut wakes = WakeSet::new([&reader as &dyn Wakeable]);
    while !stop.is_set() {
        wakes.wait(WAIT)?;
        while let Some(sample) = reader.next()? {
            sink.put(&sample);
            // A topic that is faster than this thread never runs empty.
            if stop.is_set() {
                break;
            }
        }
    }
    drain_published_before(now_ns(), &reader, sink)
}

fn drain_published_before(end_ns: u64, reader: &AnyReader, sink: &mut QueueSink) -> Result<(), WireError> {
    while let Some(sample) = reader.next()? {
        sink.put(&sample);
        if sample.stamp().t_publish_ns > end_ns {
            break;
        }
    }
    Ok(())
}

/// Only the first try has a receiver; the others are seen in the summary.
fn report(opened: &Sender<Opened>, result: Opened) {
    let _ = opened.send(result);
}
