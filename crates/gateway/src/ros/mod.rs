//! The twins as a node of ROS 2, on the wire of `rmw_zenoh` (docs/ros2.md): tokens make node and topics appear in the graph, keys hold
//! type and hash, messages are CDR with an attachment of number, time and sender. Services are answered by a thread of their own, those
//! that ask a twin by another one.

mod attachment;
mod cdr;
mod config;
mod describe;
mod inlet;
mod marker;
mod message;
mod names;
mod outlet;
mod question;
mod questions;
mod requests;
mod service;
mod twins;
mod types;

use crate::link::Link;
use names::{Names, token};
use outlet::Outlets;
use std::thread;
use std::time::{Duration, Instant};
use wire::{Bus, KeyExpr};

pub use config::{Ros2, Ros2File, check};
pub use inlet::{Inlet, reading};
pub use questions::{channel as questions, run as ask};
pub use requests::run as answer;

/// How often the domain is scanned, and how often it is checked who subscribes.
const SCAN: Duration = Duration::from_millis(250);
/// How often open topics are emptied.
const PACE: Duration = Duration::from_millis(2);

/// Moves samples until the gateway ends; fields at most every `period`.
///
/// # Errors
/// When the domain cannot be joined or the session is closed.
pub fn run(link: &Link, ros: &Ros2, keys: &[KeyExpr], period: Duration) -> anyhow::Result<()> {
    let bus = Bus::open(&link.domain)?;
    let names = Names::new(ros, link);
    let _node = token(link, names.node())?;
    let offset_ns = recording::wall_offset_ns();
    let mut outlets = Outlets::default();
    let mut scan_at = Instant::now();
    while link.goes_on() {
        let now = Instant::now();
        if now >= scan_at {
            scan_at = now + SCAN;
            outlets.announce(link, &bus, &names, ros, keys)?;
            outlets.adjust(&bus);
        }
        outlets.pump(offset_ns, now, period);
        thread::sleep(if outlets.is_read() { PACE } else { SCAN / 5 });
    }
    Ok(())
}

/// Bytes of another writer, kept as hexadecimal digits.
#[cfg(test)]
#[path = "../../tests/unit/golden.rs"]
mod golden;
