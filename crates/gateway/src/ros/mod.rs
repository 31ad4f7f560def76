//! The twins as a node of ROS 2, on the wire of `rmw_zenoh` (docs/ros2.md): tokens make node and topics appear in the graph, keys hold
//! type and hash, messages are CDR with an attachment of number, time and sender.

mod attachment;
mod cdr;
mod commands;
mod config;
mod describe;
mod inlet;
mod marker;
mod message;
mod names;
mod outlet;
mod question;
mod questions;
mod service;
mod services;
mod types;

use crate::link::Link;
use names::{Names, token};
use outlet::Outlets;
use questions::Asking;
use service::Call;
use services::Services;
use std::sync::mpsc::SyncSender;
use std::time::{Duration, Instant};
use wire::{Bus, KeyExpr};

pub use commands::run as commands;
pub use config::{Ros2, Ros2File, check};
pub use inlet::{Inlet, reading};
pub use questions::{channel as questions, run as ask};

/// Interval of scans of the local topics and of checks for subscribers.
const SCAN: Duration = Duration::from_millis(250);
/// Longest sleep while a topic is read or a request waits for a state.
const PACE: Duration = Duration::from_millis(2);
/// Longest sleep otherwise.
const TICK: Duration = Duration::from_millis(50);

/// Publishes samples and answers requests until the gateway ends; fields at most every `period`. Queries for a twin go to
/// `questions`.
///
/// # Errors
/// When the shared memory cannot be opened or the session is closed.
pub fn run(
    link: &Link,
    ros: &Ros2,
    keys: &[KeyExpr],
    period: Duration,
    questions: SyncSender<Call<Asking>>,
) -> anyhow::Result<()> {
    let bus = Bus::open(&link.domain)?;
    let names = Names::new(ros, link);
    let _node = token(link, names.node())?;
    let offset_ns = recording::wall_offset_ns();
    let (mut outlets, mut services) = (Outlets::default(), Services::new(questions));
    let mut scan_at = Instant::now();
    while link.is_running() {
        let now = Instant::now();
        if now >= scan_at {
            scan_at = now + SCAN;
            let mut found = Vec::new();
            for key in keys {
                found.extend(bus.topics(key)?);
            }
            outlets.announce(link, &names, ros, &found)?;
            outlets.adjust(&bus);
            services.announce(link, &names, &found)?;
        }
        outlets.pump(offset_ns, now, period);
        let is_busy = outlets.is_read() || services.are_waiting();
        services.serve(&bus, ros, if is_busy { PACE } else { TICK });
    }
    Ok(())
}

/// Messages written by `rosbags`, as hexadecimal digits.
#[cfg(test)]
#[path = "../../tests/unit/golden.rs"]
mod golden;
