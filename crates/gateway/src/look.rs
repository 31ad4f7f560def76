//! What there is on this machine: new topics go to those who move them, living twins are announced.

use crate::lane::Lane;
use crate::link::{Link, network};
use crate::questions::Desk;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::mpsc::Sender;
use std::time::Duration;
use wire::{Bus, KeyExpr, Topic, TopicInfo, TopicKind, WireError};
use zenoh::Wait;
use zenoh::liveliness::LivelinessToken;
use zenoh::query::Queryable;

/// How often it is looked.
pub const EVERY: Duration = Duration::from_millis(250);
/// Longest time for removing what dead programs left, so that a killed twin is not taken for a living one.
const CLEANING: Duration = Duration::from_millis(5);

/// The eye on the local domain.
pub struct Look {
    bus: Bus,
    keys: Vec<KeyExpr>,
    inlets: Vec<Topic>,
    small: Sender<Lane>,
    fields: Sender<Lane>,
    desk: Desk,
    seen: BTreeSet<String>,
    desks: BTreeMap<String, Vec<Queryable<()>>>,
    tokens: BTreeMap<String, LivelinessToken>,
}

impl Look {
    /// An eye that has seen nothing yet.
    ///
    /// # Errors
    /// When the domain cannot be joined.
    pub fn new(
        link: &Link,
        config: &crate::config::Config,
        small: Sender<Lane>,
        fields: Sender<Lane>,
        desk: Desk,
    ) -> Result<Self, WireError> {
        Ok(Self {
            bus: Bus::open(&link.domain)?,
            keys: config.keys.clone(),
            inlets: config.inlets.clone(),
            small,
            fields,
            desk,
            seen: BTreeSet::new(),
            desks: BTreeMap::new(),
            tokens: BTreeMap::new(),
        })
    }

    /// Looks once.
    ///
    /// # Errors
    /// When the domain's folder cannot be read, or the session is closed.
    pub fn look(&mut self, link: &Link) -> anyhow::Result<()> {
        self.bus.clean_up(CLEANING);
        let mut found: Vec<TopicInfo> = Vec::new();
        for key in &self.keys {
            found.extend(self.bus.topics(key)?);
        }
        for info in &found {
            self.meet(link, &info.topic)?;
        }
        self.announce(link, &found)
    }

    /// Announces a topic that is new and passes it on. What comes from the network does not go back there.
    fn meet(&mut self, link: &Link, topic: &Topic) -> anyhow::Result<()> {
        if self.inlets.contains(topic) || self.seen.contains(topic.name()) {
            return Ok(());
        }
        let lane = Lane::declare(link, topic.clone())?;
        if topic.kind() == TopicKind::State {
            let desk = self.desk.open(link, topic.actuator())?;
            self.desks.insert(topic.actuator().to_owned(), desk);
        }
        self.seen.insert(topic.name().to_owned());
        tracing::info!("{} is on the network as {}", topic, link.topic_key(topic));
        // A thread that is gone has said why; the main loop sees it.
        let _ = match topic.kind() {
            TopicKind::Field => self.fields.send(lane),
            _ => self.small.send(lane),
        };
        Ok(())
    }

    /// One token for every actuator whose state has a living writer.
    fn announce(&mut self, link: &Link, found: &[TopicInfo]) -> anyhow::Result<()> {
        let lives = |info: &&TopicInfo| info.topic.kind() == TopicKind::State && !info.writers.is_empty();
        let living: BTreeSet<&str> = found.iter().filter(lives).map(|info| info.topic.actuator()).collect();
        self.tokens.retain(|actuator, _| {
            let stays = living.contains(actuator.as_str());
            if !stays {
                tracing::info!("the twin of {actuator} has gone");
            }
            stays
        });
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
