//! One port of any kind, emptied into whatever takes messages.

use wire::{
    Bus, CommandReader, FieldReader, GraspReader, HealthReader, SensorReader, StateReader, Topic, TopicKind,
    Wakeable, Waking, WireError,
};

use crate::message::{
    CommandMessage, FieldMessage, GraspMessage, HealthMessage, Recorded, SensorMessage, StateMessage,
};

/// Identity of a sample.
#[derive(Debug, Clone, Copy)]
pub struct Stamp {
    /// The run of the sender.
    pub boot_id: u64,
    /// Its number within the run.
    pub seq: u64,
    /// When it was sent (a reading: taken), ns of the monotonic clock.
    pub t_publish_ns: u64,
}

/// Where the messages of a [`Port`] go.
pub trait Outlet {
    /// Takes one message of a topic.
    fn put<M: Recorded>(&mut self, topic: &str, stamp: Stamp, message: &M);

    /// Is told which model an actuator's states come from, with every state.
    fn model(&mut self, actuator: &str, hash: &str);
}

/// A reader of one topic, of any kind.
#[derive(Debug)]
pub enum Port {
    /// Of readings.
    Sensor(SensorReader),
    /// Of states.
    State(StateReader),
    /// Of health.
    Health(HealthReader),
    /// Of fields.
    Field(FieldReader),
    /// Of grasps.
    Grasp(GraspReader),
    /// Of pressure commands.
    Command(CommandReader),
}

impl Port {
    /// Reads `topic`, which may come into being later, woken or not.
    ///
    /// # Errors
    /// As the readers' own: another version, no free slot.
    pub fn open(bus: &Bus, topic: &Topic, waking: Waking) -> Result<Self, WireError> {
        Ok(match topic.kind() {
            TopicKind::Sensor => Self::Sensor(SensorReader::attach_as(bus, topic, waking)?),
            TopicKind::State => Self::State(StateReader::attach_as(bus, topic, waking)?),
            TopicKind::Health => Self::Health(HealthReader::attach_as(bus, topic, waking)?),
            TopicKind::Field => Self::Field(FieldReader::attach_as(bus, topic, waking)?),
            TopicKind::Grasp => Self::Grasp(GraspReader::attach_as(bus, topic, waking)?),
            TopicKind::Command => Self::Command(CommandReader::attach_as(bus, topic, waking)?),
        })
    }

    /// The topic.
    pub fn topic(&self) -> &Topic {
        match self {
            Self::Sensor(reader) => reader.topic(),
            Self::State(reader) => reader.topic(),
            Self::Health(reader) => reader.topic(),
            Self::Field(reader) => reader.topic(),
            Self::Grasp(reader) => reader.topic(),
            Self::Command(reader) => reader.topic(),
        }
    }

    /// What to wait for.
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

    /// Hands over everything that waits, oldest first.
    ///
    /// # Errors
    /// [`WireError::Receive`] when a connection broke.
    pub fn drain(&self, to: &mut impl Outlet) -> Result<(), WireError> {
        let topic = self.topic().name();
        match self {
            Self::Sensor(reader) => {
                while let Some(sample) = reader.next()? {
                    let stamp =
                        Stamp { boot_id: sample.boot_id, seq: sample.seq, t_publish_ns: sample.t_sensor_ns };
                    to.put(topic, stamp, &SensorMessage::from(&sample));
                }
            }
            Self::State(reader) => {
                while let Some(state) = reader.next()? {
                    let stamp =
                        Stamp { boot_id: state.boot_id, seq: state.seq, t_publish_ns: state.t_publish_ns };
                    let message = StateMessage::from(&state);
                    to.model(&message.actuator, &message.model_hash);
                    to.put(topic, stamp, &message);
                }
            }
            Self::Health(reader) => {
                while let Some(health) = reader.next()? {
                    let stamp =
                        Stamp { boot_id: health.boot_id, seq: health.seq, t_publish_ns: health.t_publish_ns };
                    to.put(topic, stamp, &HealthMessage::from(&health));
                }
            }
            Self::Field(reader) => {
                while let Some(field) = reader.next()? {
                    let header = field.header();
                    let stamp =
                        Stamp { boot_id: header.boot_id, seq: header.seq, t_publish_ns: header.t_publish_ns };
                    to.put(topic, stamp, &FieldMessage::new(header, field.values()));
                }
            }
            Self::Grasp(reader) => {
                while let Some(grasp) = reader.next()? {
                    let stamp =
                        Stamp { boot_id: grasp.boot_id, seq: grasp.seq, t_publish_ns: grasp.t_publish_ns };
                    to.put(topic, stamp, &GraspMessage::from(&grasp));
                }
            }
            Self::Command(reader) => {
                while let Some(sample) = reader.next()? {
                    let stamp =
                        Stamp { boot_id: sample.boot_id, seq: sample.seq, t_publish_ns: sample.t_publish_ns };
                    to.put(topic, stamp, &CommandMessage::from(&sample));
                }
            }
        }
        Ok(())
    }
}
