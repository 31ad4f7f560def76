//! Samples of any kind as messages.

use wire::layout::{Layout, Payload};
use wire::{
    AnySample, Command, Estimate, FieldHeader, Grasp, Health, SensorSample, Setpoint, State, Topic,
    TopicKind, Valve,
};

use crate::message::{self, FieldMessage, Recorded};
use crate::writer::Channel;

/// The channel of a topic's messages.
pub fn channel(topic: &Topic) -> Channel {
    let layout: &Layout = match topic.kind() {
        TopicKind::Sensor => SensorSample::LAYOUT,
        TopicKind::State => State::LAYOUT,
        TopicKind::Health => Health::LAYOUT,
        TopicKind::Field => FieldHeader::LAYOUT,
        TopicKind::Grasp => Grasp::LAYOUT,
        TopicKind::Command => Command::LAYOUT,
        TopicKind::Estimate => Estimate::LAYOUT,
        TopicKind::Setpoint | TopicKind::Override => Setpoint::LAYOUT,
        TopicKind::Valve => Valve::LAYOUT,
    };
    message::channel(layout, topic.name())
}

/// The sample as JSON, a field with its values (base64).
pub fn encode(sample: &AnySample) -> Vec<u8> {
    let mut out = Vec::with_capacity(1536);
    match sample {
        AnySample::Field(field) => FieldMessage::new(field.header(), field.values()).encode(&mut out),
        _ => sample.view().encode(&mut out),
    }
    out
}
