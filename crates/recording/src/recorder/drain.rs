//! One port of any kind, emptied into the queue.

use wire::{
    Bus, CommandReader, FieldReader, GraspReader, HealthReader, SensorReader, StateReader, Topic, TopicKind,
    Wakeable, WireError,
};

use super::queue::{Sink, Stamp};
use crate::message::{
    CommandMessage, FieldMessage, GraspMessage, HealthMessage, SensorMessage, StateMessage,
};

/// A reader of one topic.
pub enum Port {
    Sensor(SensorReader),
    State(StateReader),
    Health(HealthReader),
    Field(FieldReader),
    Grasp(GraspReader),
    Command(CommandReader),
}

impl Port {
    /// `None` for fields that nobody asked for.
    pub fn open(bus: &Bus, topic: &Topic, with_fields: bool) -> Result<Option<Self>, WireError> {
        Ok(match topic.kind() {
            TopicKind::Sensor => Some(Self::Sensor(SensorReader::attach(bus, topic)?)),
            TopicKind::State => Some(Self::State(StateReader::attach(bus, topic)?)),
            TopicKind::Health => Some(Self::Health(HealthReader::attach(bus, topic)?)),
            TopicKind::Field if with_fields => Some(Self::Field(FieldReader::attach(bus, topic)?)),
            TopicKind::Field => None,
            TopicKind::Grasp => Some(Self::Grasp(GraspReader::attach(bus, topic)?)),
            TopicKind::Command => Some(Self::Command(CommandReader::attach(bus, topic)?)),
        })
    }

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

    /// Everything that waits, oldest first.
    pub fn drain(&self, sink: &mut Sink) -> Result<(), WireError> {
        let topic = self.topic().name();
        match self {
            Self::Sensor(reader) => {
                while let Some(sample) = reader.next()? {
                    let stamp =
                        Stamp { boot_id: sample.boot_id, seq: sample.seq, t_publish_ns: sample.t_sensor_ns };
                    sink.put(topic, stamp, &SensorMessage::from(&sample));
                }
            }
            Self::State(reader) => {
                while let Some(state) = reader.next()? {
                    let stamp =
                        Stamp { boot_id: state.boot_id, seq: state.seq, t_publish_ns: state.t_publish_ns };
                    let message = StateMessage::from(&state);
                    sink.model(&message.actuator, &message.model_hash);
                    sink.put(topic, stamp, &message);
                }
            }
            Self::Health(reader) => {
                while let Some(health) = reader.next()? {
                    let stamp =
                        Stamp { boot_id: health.boot_id, seq: health.seq, t_publish_ns: health.t_publish_ns };
                    sink.put(topic, stamp, &HealthMessage::from(&health));
                }
            }
            Self::Field(reader) => {
                while let Some(field) = reader.next()? {
                    let header = field.header();
                    let stamp =
                        Stamp { boot_id: header.boot_id, seq: header.seq, t_publish_ns: header.t_publish_ns };
                    sink.put(topic, stamp, &FieldMessage::new(header, field.values()));
                }
            }
            Self::Grasp(reader) => {
                while let Some(grasp) = reader.next()? {
                    let stamp =
                        Stamp { boot_id: grasp.boot_id, seq: grasp.seq, t_publish_ns: grasp.t_publish_ns };
                    sink.put(topic, stamp, &GraspMessage::from(&grasp));
                }
            }
            Self::Command(reader) => {
                while let Some(sample) = reader.next()? {
                    let stamp =
                        Stamp { boot_id: sample.boot_id, seq: sample.seq, t_publish_ns: sample.t_publish_ns };
                    sink.put(topic, stamp, &CommandMessage::from(&sample));
                }
            }
        }
        Ok(())
    }
}
