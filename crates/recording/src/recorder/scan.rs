//! Scan for topics, in a separate thread: it reads the management folder, which a busy disk may delay by seconds.

use std::collections::BTreeSet;
use std::sync::mpsc::Sender;
use std::time::Duration;

use wire::{Bus, Domain, KeyExpr, Topic, WireError};

use wire::thread_group::StopFlag;

/// Period of the scan.
const EVERY: Duration = Duration::from_millis(250);

/// Topics that were not there at the scan before, or why it failed.
pub type ScanResult = Result<Vec<Topic>, WireError>;

/// Scan of `domain` for topics that any of `keys` matches. The bus is opened at the first scan.
pub struct TopicScan {
    domain: Domain,
    keys: Vec<KeyExpr>,
    bus: Option<Bus>,
}

impl TopicScan {
    pub fn new(domain: Domain, keys: Vec<KeyExpr>) -> Self {
        Self { domain, keys, bus: None }
    }

    pub fn scan(&mut self) -> ScanResult {
        let bus = match &mut self.bus {
            Some(bus) => bus,
            none => none.insert(Bus::open(&self.domain)?),
        };
        let mut found = Vec::new();
        for key in &self.keys {
            found.extend(bus.names(key)?);
        }
        Ok(found)
    }
}

/// Scans repeatedly and sends new topics, until `stop` is set.
pub fn keep_scanning(mut scan: impl FnMut() -> ScanResult, found: &Sender<ScanResult>, stop: &StopFlag) {
    let mut seen = BTreeSet::new();
    while !stop.is_set() {
        let result = scan().map(|mut topics| {
            topics.retain(|topic| seen.insert(topic.name().to_owned()));
            topics
        });
        // A receiver that is gone: the stop flag is about to be set.
        let _ = found.send(result);
        stop.pause(EVERY);
    }
}
