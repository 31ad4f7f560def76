//! One topic on its way to the queue, in a thread of its own: opening a topic writes to the domain's folder, and what a busy
//! disk holds up there must not hold up the others.

use std::sync::mpsc::Sender;
use std::time::Duration;

use wire::{Bus, Domain, Topic, WakeSet, Waking, WireError};

use super::crew::{Stop, WAIT};
use super::drain::Port;
use super::queue::Sink;

/// Pause before a topic that cannot be read is tried again.
const RETRY: Duration = Duration::from_secs(1);

/// How a try to open a topic ended.
pub type Opened = Result<(), WireError>;

/// Moves everything of `topic` into `sink`, and opens it again when it breaks. `opened` hears of each try.
pub fn keep_moving(domain: &Domain, topic: &Topic, mut sink: Sink, opened: &Sender<Opened>, stop: &Stop) {
    while !stop.is_set() {
        if let Err(error) = open_and_move(domain, topic, &mut sink, opened, stop) {
            sink.trouble(topic, Some(error.to_string()));
            tell(opened, Err(error));
            stop.pause(RETRY);
        }
    }
}

/// Returns at the end, or when the topic cannot be opened or breaks.
fn open_and_move(
    domain: &Domain,
    topic: &Topic,
    sink: &mut Sink,
    opened: &Sender<Opened>,
    stop: &Stop,
) -> Result<(), WireError> {
    let bus = Bus::open(domain)?;
    let port = Port::open(&bus, topic, Waking::ByEvent)?;
    sink.trouble(topic, None);
    tell(opened, Ok(()));
    let mut wakes = WakeSet::new([port.wakeable()]);
    while !stop.is_set() {
        wakes.wait([port.wakeable()], WAIT)?;
        port.drain(sink)?;
    }
    port.drain(sink)
}

/// Only the first try has a listener; that nobody hears the others is as it should be.
fn tell(opened: &Sender<Opened>, how: Opened) {
    let _ = opened.send(how);
}
