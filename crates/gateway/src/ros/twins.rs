//! The newest states of the twins, read only while somebody asks.

use super::attachment::plain;
use crate::link::Link;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};
use wire::{AnyReader, AnySample, Bus, KeyExpr, State, Topic, TopicKind, Waking, WireError};

/// How often the domain is scanned.
const SCAN: Duration = Duration::from_millis(250);
/// How long states are read after the last question: repeated ones must not look like a new reader each time.
const LINGER: Duration = Duration::from_secs(5);

/// The twins of the domain.
pub struct Twins {
    bus: Bus,
    keys: Vec<KeyExpr>,
    /// By the actuator's name in ROS.
    by_name: BTreeMap<String, Twin>,
    scan_at: Instant,
    wanted_until: Option<Instant>,
}

/// One twin.
struct Twin {
    topic: Topic,
    is_alive: bool,
    reader: Option<AnyReader>,
    newest: Option<AnySample>,
}

impl Twins {
    /// Of none yet.
    ///
    /// # Errors
    /// When the domain cannot be joined.
    pub fn open(link: &Link, keys: &[KeyExpr]) -> Result<Self, WireError> {
        let bus = Bus::open(&link.domain)?;
        Ok(Self {
            bus,
            keys: keys.to_vec(),
            by_name: BTreeMap::new(),
            scan_at: Instant::now(),
            wanted_until: None,
        })
    }

    /// Looks which twins live, when that is due.
    ///
    /// # Errors
    /// When the domain's folder cannot be read.
    pub fn scan(&mut self, now: Instant) -> Result<(), WireError> {
        if now < self.scan_at {
            return Ok(());
        }
        self.scan_at = now + SCAN;
        self.by_name.values_mut().for_each(|twin| twin.is_alive = false);
        for key in &self.keys {
            for info in self.bus.topics(key)? {
                if info.topic.kind() == TopicKind::State {
                    let name = plain(info.topic.actuator());
                    let twin = self.by_name.entry(name).or_insert_with(|| Twin::new(info.topic));
                    twin.is_alive |= !info.writers.is_empty();
                }
            }
        }
        Ok(())
    }

    /// Notes that somebody asks.
    pub fn want(&mut self, now: Instant) {
        self.wanted_until = Some(now + LINGER);
    }

    /// Reads what waits while somebody asks; otherwise nothing is read or kept.
    pub fn pump(&mut self, now: Instant) {
        let is_wanted = self.wanted_until.is_some_and(|until| now < until);
        for twin in self.by_name.values_mut() {
            if !(is_wanted && twin.is_alive) {
                (twin.reader, twin.newest) = (None, None);
            } else if let Err(error) = twin.read(&self.bus) {
                tracing::warn!("{error}; opening the topic again");
                twin.reader = None;
            }
        }
    }

    /// Names of the twins that live.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.by_name.iter().filter(|(_, twin)| twin.is_alive).map(|(name, _)| name.as_str())
    }

    /// The actuator of a twin that lives or lived, by its name in ROS.
    pub fn actuator(&self, name: &str) -> Option<&str> {
        Some(self.by_name.get(name)?.topic.actuator())
    }

    /// The newest state of a twin; none before it came.
    pub fn state(&self, name: &str) -> Option<&State> {
        match self.by_name.get(name)?.newest.as_ref()? {
            AnySample::State(state) => Some(state),
            _ => None,
        }
    }
}

impl Twin {
    fn new(topic: Topic) -> Self {
        Self { topic, is_alive: false, reader: None, newest: None }
    }

    fn read(&mut self, bus: &Bus) -> Result<(), WireError> {
        let reader = match self.reader.take() {
            Some(reader) => reader,
            None => AnyReader::attach_as(bus, &self.topic, Waking::Never)?,
        };
        if let Some(sample) = reader.newest()? {
            self.newest = Some(sample);
        }
        self.reader = Some(reader);
        Ok(())
    }
}
