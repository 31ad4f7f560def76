//! Scans the local topics: new ones are announced and passed to the threads that publish them; running twins get a token.

use crate::config::Config;
use crate::link::{Link, network};
use crate::queries::QueryHandler;
use crate::topic_bridge::TopicBridge;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::mpsc::Sender;
use std::time::Duration;
use wire::{Bus, KeyExpr, Topic, TopicInfo, TopicKind, WireError};
use zenoh::Wait;
use zenoh::liveliness::LivelinessToken;
use zenoh::query::Queryable;

/// Interval of scans.
pub const EVERY: Duration = Duration::from_millis(250);
/// Longest time for removing files of ended programs, so that a killed twin does not seem alive.
const CLEANING: Duration = Duration::from_millis(5);

/// Scan of the local topics.
pub struct TopicScan {
    bus: Bus,
    keys: Vec<KeyExpr>,
    inlets: Vec<Topic>,
    messages: Sender<TopicBridge>,
    fields: Sender<TopicBridge>,
    handler: QueryHandler,
    seen: BTreeSet<String>,
    queryables: BTreeMap<String, Vec<Queryable<()>>>,
    tokens: BTreeMap<String, LivelinessToken>,
}

impl TopicScan {
    /// A scan that has found nothing yet.
    ///
    /// # Errors
    /// When the shared memory cannot be opened.
    pub fn new(
        link: &Link,
        config: &Config,
        messages: Sender<TopicBridge>,
        fields: Sender<TopicBridge>,
        handler: QueryHandler,
    ) -> Result<Self, WireError> {
        Ok(Self {
            bus: Bus::open(&link.domain)?,
            keys: config.keys.clone(),
            inlets: config.inlets.clone(),
            messages,
            fields,
            handler,
            seen: BTreeSet::new(),
            queryables: BTreeMap::new(),
            tokens: BTreeMap::new(),
        })
    }

    /// Scans once.
    ///
    /// # Errors
    /// When the topics cannot be listed, or the session is closed.
    pub fn scan(&mut self, link: &Link) -> anyhow::Result<()> {
        self.bus.clean_up(CLEANING);
        let mut found: Vec<TopicInfo> = Vec::new();
        for key in &self.keys {
            found.extend(self.bus.topics(key)?);
        }
        for info in &found {
            self.announce_topic(link, &info.topic)?;
        }
        self.announce_twins(link, &found)
    }

    /// Announces a new topic, unless its readings come from the network.
    fn announce_topic(&mut self, link: &Link, topic: &Topic) -> anyhow::Result<()> {
        if self.inlets.contains(topic) || self.seen.contains(topic.name()) {
            return Ok(());
        }
        let bridge = TopicBridge::declare(link, topic.clone())?;
        if topic.kind() == TopicKind::State {
            let queryables = self.handler.open(link, topic.actuator())?;
            self.queryables.insert(topic.actuator().to_owned(), queryables);
        }
        self.seen.insert(topic.name().to_owned());
        tracing::info!("{topic} is on the network as {}", link.key(topic.name()));
        // If the receiving thread has ended, the main loop sees it.
        let _ = match topic.kind() {
            TopicKind::Field => self.fields.send(bridge),
            _ => self.messages.send(bridge),
        };
        Ok(())
    }

    /// Declares a token for every actuator whose state has a writer.
    fn announce_twins(&mut self, link: &Link, found: &[TopicInfo]) -> anyhow::Result<()> {
        let lives = |info: &&TopicInfo| info.topic.kind() == TopicKind::State && !info.writers.is_empty();
        let living: BTreeSet<&str> = found.iter().filter(lives).map(|info| info.topic.actuator()).collect();
        for (actuator, _) in self.tokens.extract_if(.., |actuator, _| !living.contains(actuator.as_str())) {
            tracing::info!("the twin of {actuator} has gone");
        }
        for actuator in living {
            if !self.tokens.contains_key(actuator) {
                tracing::info!("the twin of {actuator} is alive");
                let key = link.key(&format!("softtwin/{actuator}/alive"));
                let token = network(link.session.liveliness().declare_token(key).wait())?;
                self.tokens.insert(actuator.to_owned(), token);
            }
        }
        Ok(())
    }
}
