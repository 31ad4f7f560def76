//! A reader of any kind of topic, for programs that treat all topics alike.

use super::topic::{FieldReader, FieldSample, Reader};
use crate::bus::Bus;
use crate::error::WireError;
use crate::layout::{
    Command, Estimate, Grasp, Health, Payload, SensorSample, Setpoint, State, Target, Valve, View,
};
use crate::topic::{Topic, TopicKind};
use crate::wake::{Wakeable, Waker, Waking};

macro_rules! kinds {
    ($($kind:ident: $payload:ident),+) => {
        /// A reader of any kind of topic.
        #[derive(Debug)]
        #[allow(missing_docs)] // the kinds are those of `TopicKind`
        pub enum AnyReader {
            $($kind(Reader<$payload>),)+
            Field(FieldReader),
        }

        /// A sample of any kind of topic.
        #[derive(Debug)]
        #[allow(missing_docs)] // the kinds are those of `TopicKind`
        #[allow(clippy::large_enum_variant)] // 752 bytes are moved once; a box would allocate for every state
        pub enum AnySample {
            $($kind($payload),)+
            /// A field, still in shared memory.
            Field(FieldSample),
        }

        impl AnyReader {
            /// Reads a topic that must exist.
            ///
            /// # Errors
            /// As [`Reader::open`].
            pub fn open(bus: &Bus, topic: &Topic) -> Result<Self, WireError> {
                Ok(match topic.kind() {
                    $(TopicKind::$kind => Self::$kind(Reader::open(bus, topic)?),)+
                    TopicKind::Field => Self::Field(FieldReader::open(bus, topic)?),
                })
            }

            /// Reads a topic that may come into being later, woken or not.
            ///
            /// # Errors
            /// As [`Reader::attach`].
            pub fn attach_as(bus: &Bus, topic: &Topic, waking: Waking) -> Result<Self, WireError> {
                Ok(match topic.kind() {
                    $(TopicKind::$kind => Self::$kind(Reader::attach_as(bus, topic, waking)?),)+
                    TopicKind::Field => Self::Field(FieldReader::attach_as(bus, topic, waking)?),
                })
            }

            /// The topic.
            pub fn topic(&self) -> &Topic {
                match self {
                    $(Self::$kind(reader) => reader.topic(),)+
                    Self::Field(reader) => reader.topic(),
                }
            }

            /// The oldest waiting sample, if there is one. Never blocks.
            ///
            /// # Errors
            /// [`WireError::Receive`] when a connection broke.
            pub fn next(&self) -> Result<Option<AnySample>, WireError> {
                Ok(match self {
                    $(Self::$kind(reader) => reader.next()?.map(AnySample::$kind),)+
                    Self::Field(reader) => reader.next()?.map(AnySample::Field),
                })
            }

            /// The newest waiting sample; the older ones are discarded. Never blocks.
            ///
            /// # Errors
            /// As [`Self::next`].
            pub fn newest(&self) -> Result<Option<AnySample>, WireError> {
                Ok(match self {
                    $(Self::$kind(reader) => reader.newest()?.map(AnySample::$kind),)+
                    Self::Field(reader) => reader.newest()?.map(AnySample::Field),
                })
            }

            /// True if a sample is waiting; false on errors, which [`Self::next`] returns. Never blocks, takes nothing.
            pub fn has_next(&self) -> bool {
                match self {
                    $(Self::$kind(reader) => reader.has_next(),)+
                    Self::Field(reader) => reader.has_next(),
                }
            }
        }

        impl Wakeable for AnyReader {
            fn waker(&self) -> Waker {
                match self {
                    $(Self::$kind(reader) => reader.waker(),)+
                    Self::Field(reader) => reader.waker(),
                }
            }
        }

        impl AnySample {
            /// The payload's bytes with what they mean; of a field those of its header.
            pub fn view(&self) -> View<'_> {
                match self {
                    $(Self::$kind(sample) => sample.view(),)+
                    Self::Field(sample) => sample.header().view(),
                }
            }
        }
    };
}
kinds!(
    Sensor: SensorSample, State: State, Health: Health, Grasp: Grasp, Command: Command, Estimate: Estimate, Setpoint: Setpoint,
    Override: Setpoint, Target: Target, Valve: Valve
);

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

impl AnySample {
    /// Identity and times.
    pub fn stamp(&self) -> Stamp {
        let view = self.view();
        let whole = |name| view.whole(name).unwrap_or(0);
        let t_sensor_ns = whole("t_sensor_ns");
        let t_publish_ns = view.whole("t_publish_ns").unwrap_or(t_sensor_ns);
        Stamp { boot_id: whole("boot_id"), seq: whole("seq"), t_sensor_ns, t_publish_ns }
    }
}
