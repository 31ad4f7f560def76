//! How a twin comes to its topics: as the first one, or from another twin that serves them.

use wire::{Bus, FieldWriter, Payload, Topic, WireError, Writer};

/// Whether a writer takes its right when it is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Entry {
    /// At once: a second twin is refused.
    AtOnce,
    /// Later, from another twin: `Twin::take_over`.
    StandBy,
}

impl Entry {
    pub(super) fn writer<P: Payload>(self, bus: &Bus, topic: &Topic) -> Result<Writer<P>, WireError> {
        match self {
            Self::AtOnce => Writer::create(bus, topic),
            Self::StandBy => Writer::stand_by(bus, topic),
        }
    }

    pub(super) fn field_writer(
        self,
        bus: &Bus,
        topic: &Topic,
        entries: usize,
    ) -> Result<FieldWriter, WireError> {
        match self {
            Self::AtOnce => FieldWriter::create(bus, topic, entries),
            Self::StandBy => FieldWriter::stand_by(bus, topic, entries),
        }
    }
}
