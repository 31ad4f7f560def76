//! Readers and samples of any kind of topic, for programs that take topics as they find them.

use crate::bus::{Bus, Ipc};
use crate::port::{
    CommandReader, FieldReader, FieldSample, GraspReader, HealthReader, SensorReader, StateReader,
};
use crate::wake::{Wakeable, Waking};
use crate::{Command, Grasp, Health, SensorSample, State, Topic, TopicKind, WireError};
use iceoryx2::port::listener::Listener;

/// A reader of one topic of any kind.
#[derive(Debug)]
#[allow(missing_docs)] // each is named like its reader
pub enum AnyReader {
    Sensor(SensorReader),
    State(StateReader),
    Health(HealthReader),
    Field(FieldReader),
    Grasp(GraspReader),
    Command(CommandReader),
}

/// A received sample of any kind.
#[derive(Debug)]
#[allow(missing_docs)] // each is named like its payload
pub enum AnySample {
    Sensor(SensorSample),
    State(Box<State>),
    Health(Health),
    /// Still in shared memory, and not copied.
    Field(FieldSample),
    Grasp(Grasp),
    Command(Command),
}

/// Identity and times of a sample, as its sender wrote them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stamp {
    /// The run of the sender.
    pub boot_id: u64,
    /// Its number within the run.
    pub seq: u64,
    /// When the reading behind it was taken, ns of the monotonic clock; 0: there is none.
    pub t_sensor_ns: u64,
    /// When it was sent (a reading: taken), ns of the monotonic clock.
    pub t_publish_ns: u64,
}

/// Does the same with the reader or the sample of every kind.
macro_rules! for_each_kind {
    ($Any:ident, $any:expr, $inner:ident => $result:expr) => {
        match $any {
            $Any::Sensor($inner) => $result,
            $Any::State($inner) => $result,
            $Any::Health($inner) => $result,
            $Any::Field($inner) => $result,
            $Any::Grasp($inner) => $result,
            $Any::Command($inner) => $result,
        }
    };
}

impl AnyReader {
    /// Reads a topic that must exist.
    ///
    /// # Errors
    /// As [`SensorReader::open`].
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

    /// Reads a topic that may come into being later, woken or not.
    ///
    /// # Errors
    /// As [`SensorReader::attach`].
    pub fn attach_as(bus: &Bus, topic: &Topic, waking: Waking) -> Result<Self, WireError> {
        Ok(match topic.kind() {
            TopicKind::Sensor => Self::Sensor(SensorReader::attach_as(bus, topic, waking)?),
            TopicKind::State => Self::State(StateReader::attach_as(bus, topic, waking)?),
            TopicKind::Health => Self::Health(HealthReader::attach_as(bus, topic, waking)?),
            TopicKind::Field => Self::Field(FieldReader::attach_as(bus, topic, waking)?),
            TopicKind::Grasp => Self::Grasp(GraspReader::attach_as(bus, topic, waking)?),
            TopicKind::Command => Self::Command(CommandReader::attach_as(bus, topic, waking)?),
        })
    }

    /// The oldest waiting sample, if there is one. Never blocks.
    ///
    /// # Errors
    /// [`WireError::Receive`] when a connection broke.
    pub fn next(&self) -> Result<Option<AnySample>, WireError> {
        for_each_kind!(Self, self, reader => Ok(reader.next()?.map(AnySample::from)))
    }

    /// The topic.
    pub fn topic(&self) -> &Topic {
        for_each_kind!(Self, self, reader => reader.topic())
    }
}

impl Wakeable for AnyReader {
    fn listener(&self) -> Option<&Listener<Ipc>> {
        for_each_kind!(Self, self, reader => reader.listener())
    }
}

macro_rules! any_sample_from {
    ($($payload:ty => $kind:ident $(in $wrapper:ident)?),* $(,)?) => {$(
        impl From<$payload> for AnySample {
            fn from(sample: $payload) -> Self {
                Self::$kind($($wrapper::new)?(sample))
            }
        }
    )*};
}

any_sample_from! {
    SensorSample => Sensor,
    State => State in Box,
    Health => Health,
    FieldSample => Field,
    Grasp => Grasp,
    Command => Command,
}

impl AnySample {
    /// Identity and times.
    pub fn stamp(&self) -> Stamp {
        let of = |boot_id, seq, t_sensor_ns, t_publish_ns| Stamp { boot_id, seq, t_sensor_ns, t_publish_ns };
        match self {
            Self::Sensor(s) => of(s.boot_id, s.seq, s.t_sensor_ns, s.t_sensor_ns),
            Self::State(s) => of(s.boot_id, s.seq, s.t_sensor_ns, s.t_publish_ns),
            Self::Health(s) => of(s.boot_id, s.seq, 0, s.t_publish_ns),
            Self::Field(s) => {
                let header = s.header();
                of(header.boot_id, header.seq, header.t_sensor_ns, header.t_publish_ns)
            }
            Self::Grasp(s) => of(s.boot_id, s.seq, s.t_sensor_ns, s.t_publish_ns),
            Self::Command(s) => of(s.boot_id, s.seq, s.t_sensor_ns, s.t_publish_ns),
        }
    }
}
