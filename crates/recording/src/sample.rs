//! Samples of any kind as messages.

use wire::{AnySample, Topic, TopicKind};

use crate::message::{
    CommandMessage, FieldMessage, GraspMessage, HealthMessage, Recorded, SensorMessage, StateMessage,
};
use crate::writer::Channel;

/// The channel of a topic's messages.
pub fn channel(topic: &Topic) -> Channel {
    let name = topic.name();
    match topic.kind() {
        TopicKind::Sensor => SensorMessage::channel(name),
        TopicKind::State => StateMessage::channel(name),
        TopicKind::Health => HealthMessage::channel(name),
        TopicKind::Field => FieldMessage::channel(name),
        TopicKind::Grasp => GraspMessage::channel(name),
        TopicKind::Command => CommandMessage::channel(name),
    }
}

/// The sample as JSON, a field with its values (base64).
pub fn encode(sample: &AnySample) -> Vec<u8> {
    let mut out = Vec::with_capacity(1536);
    match sample {
        AnySample::Sensor(sample) => SensorMessage::from(sample).encode(&mut out),
        AnySample::State(sample) => StateMessage::from(&**sample).encode(&mut out),
        AnySample::Health(sample) => HealthMessage::from(sample).encode(&mut out),
        AnySample::Field(sample) => FieldMessage::new(sample.header(), sample.values()).encode(&mut out),
        AnySample::Grasp(sample) => GraspMessage::from(sample).encode(&mut out),
        AnySample::Command(sample) => CommandMessage::from(sample).encode(&mut out),
    }
    out
}
