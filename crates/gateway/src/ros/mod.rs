//! The twins as a node of ROS 2, on the wire of `rmw_zenoh` (docs/ros2.md): tokens make node and topics appear in the graph, keys hold
//! type and hash, messages are CDR with an attachment of number, time and sender.

mod config;
mod message;
mod services;
mod topics;
mod wire_format;

use crate::link::Link;
use services::{Call, Services};
use std::sync::mpsc::SyncSender;
use std::thread;
use std::time::{Duration, Instant};
use topics::Outlets;
use wire::{Bus, KeyExpr};
use wire_format::{Names, token};

pub use config::{Ros2, Ros2File, check_config};
pub use services::{channel as calls, run as answer_calls};
pub use topics::{announce_readings, reading, run_commands};

/// Interval of scans of the local topics and of checks for subscribers.
const SCAN: Duration = Duration::from_millis(250);
/// Longest sleep while a topic is read.
const PACE: Duration = Duration::from_millis(2);
/// Longest sleep otherwise.
const TICK: Duration = Duration::from_millis(50);

/// Publishes samples until the gateway ends, fields at most every `period`, and announces the services of the twins, whose requests go to
/// `calls`.
pub fn run(
    link: &Link,
    ros: &Ros2,
    keys: &[KeyExpr],
    period: Duration,
    calls: SyncSender<Call>,
) -> anyhow::Result<()> {
    let bus = Bus::open(&link.domain)?;
    let names = Names::new(ros, link);
    let _node = token(link, names.node())?;
    let offset_ns = recording::wall_offset_ns();
    let (mut outlets, mut services) = (Outlets::default(), Services::new(calls));
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
        thread::sleep(if outlets.is_read() { PACE } else { TICK });
    }
    Ok(())
}

/// Messages written by `rosbags`, as hexadecimal digits.
#[cfg(test)]
#[path = "../../tests/unit/golden.rs"]
mod golden;
