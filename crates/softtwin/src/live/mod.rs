//! What the commands that listen share: the domain, topics by key expression, readers of every kind, the wait.

mod sample;
mod text;

pub use sample::{Sample, SeqTracker};

use crate::failure::usage;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use wire::{
    Bus, CommandReader, Domain, FieldReader, GraspReader, HealthReader, KeyExpr, SensorReader, StateReader,
    Topic, TopicInfo, TopicKind, Wake, WakeSet, Wakeable, WireError,
};

/// Which programs see one another.
#[derive(Debug, Clone, clap::Args)]
pub struct DomainArgs {
    /// Shared-memory domain [default: $SOFTTWIN_DOMAIN, or iceoryx2's own].
    #[arg(long, value_name = "NAME")]
    domain: Option<String>,
    /// Folder of the domain's management files [default: $SOFTTWIN_ROOT, or iceoryx2's own].
    #[arg(long, value_name = "DIR")]
    domain_root: Option<PathBuf>,
}

impl DomainArgs {
    /// Joins the domain.
    pub fn join(&self) -> Result<Bus, WireError> {
        Bus::open(&self.domain())
    }

    /// The domain that is meant.
    pub fn domain(&self) -> Domain {
        let from_env = Domain::from_env();
        let prefix = self.domain.as_deref().map_or(from_env.prefix, |name| Domain::named(name).prefix);
        let root = self.domain_root.as_ref().map(|root| root.display().to_string()).or(from_env.root);
        Domain { prefix, root }
    }
}

/// Parses a key expression or says what is wrong with it.
pub fn key(text: &str) -> anyhow::Result<KeyExpr> {
    KeyExpr::new(text).map_err(usage)
}

/// All topics that `key` matches; none is an error that says what to do.
pub fn find(bus: &Bus, key: &KeyExpr) -> anyhow::Result<Vec<TopicInfo>> {
    let found = bus.topics(key)?;
    if !found.is_empty() {
        return Ok(found);
    }
    let all = bus.topics(&self::key("softtwin/**")?)?;
    if all.is_empty() {
        anyhow::bail!(
            "nothing is there: no topic in this domain. Start `softtwind twin --scene config/scenes/finger.toml`, or \
             name the twin's domain with --domain"
        );
    }
    let names: Vec<&str> = all.iter().map(|info| info.topic.name()).collect();
    anyhow::bail!("no topic matches `{key}`; there are:\n  {}", names.join("\n  "));
}

/// A reader of any kind of topic.
#[derive(Debug)]
pub enum AnyReader {
    /// Readings.
    Sensor(SensorReader),
    /// States.
    State(StateReader),
    /// Health.
    Health(HealthReader),
    /// Fields.
    Field(FieldReader),
    /// Grasps.
    Grasp(GraspReader),
    /// Pressure commands.
    Command(CommandReader),
}

impl AnyReader {
    /// Reads an existing topic.
    pub fn open(bus: &Bus, topic: &Topic) -> Result<Self, WireError> {
        Ok(match topic.kind() {
            TopicKind::Sensor => Self::Sensor(SensorReader::open(bus, topic)?),
            TopicKind::State => Self::State(StateReader::open(bus, topic)?),
            TopicKind::Health => Self::Health(HealthReader::open(bus, topic)?),
            TopicKind::Field => Self::Field(FieldReader::open(bus, topic)?),
            TopicKind::Grasp => Self::Grasp(GraspReader::open(bus, topic)?),
            TopicKind::Command => Self::Command(CommandReader::open(bus, topic)?),
        })
    }

    /// The oldest waiting sample.
    pub fn next(&self) -> Result<Option<Sample>, WireError> {
        Ok(match self {
            Self::Sensor(reader) => reader.next()?.map(Sample::Sensor),
            Self::State(reader) => reader.next()?.map(|state| Sample::State(Box::new(state))),
            Self::Health(reader) => reader.next()?.map(Sample::Health),
            Self::Field(reader) => reader.next()?.map(Sample::Field),
            Self::Grasp(reader) => reader.next()?.map(Sample::Grasp),
            Self::Command(reader) => reader.next()?.map(Sample::Command),
        })
    }

    /// For the wait.
    pub fn wakeable(&self) -> &dyn Wakeable {
        match self {
            Self::Sensor(reader) => reader,
            Self::State(reader) => reader,
            Self::Health(reader) => reader,
            Self::Field(reader) => reader,
            Self::Grasp(reader) => reader,
            Self::Command(reader) => reader,
        }
    }
}

/// Several readers and the wait for any of them.
#[derive(Debug)]
pub struct Readers {
    /// Topic and reader.
    pub readers: Vec<(Topic, AnyReader)>,
    wake: WakeSet,
    stop: Arc<AtomicBool>,
    end: Option<Instant>,
}

impl Readers {
    /// Opens all topics that `key` matches; listens for `limit` at most, and until SIGINT or SIGTERM.
    pub fn open(bus: &Bus, key: &KeyExpr, limit: Option<Duration>) -> anyhow::Result<Self> {
        let topics = find(bus, key)?;
        let readers = topics
            .into_iter()
            .map(|info| Ok((info.topic.clone(), AnyReader::open(bus, &info.topic)?)))
            .collect::<Result<Vec<_>, WireError>>()?;
        let wake = WakeSet::new(readers.iter().map(|(_, reader)| reader.wakeable()));
        Ok(Self {
            readers,
            wake,
            stop: runtime::service::stop_flag()?,
            end: limit.map(|limit| Instant::now() + limit),
        })
    }

    /// Waits until something may be there. `false`: time is over or a signal came.
    pub fn wait(&mut self, at_most: Duration) -> Result<bool, WireError> {
        let now = Instant::now();
        let left = self.end.map_or(at_most, |end| end.saturating_duration_since(now).min(at_most));
        if self.stop.load(Ordering::Relaxed) || self.end.is_some_and(|end| now >= end) {
            return Ok(false);
        }
        let woken = self.wake.wait(self.readers.iter().map(|(_, reader)| reader.wakeable()), left)?;
        Ok(woken != Wake::Signal || !self.stop.load(Ordering::Relaxed))
    }
}
