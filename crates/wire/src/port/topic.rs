//! Ports of topics. Samples of fixed size are copied; a field is written straight into the memory that the readers map. [`AnyReader`] reads
//! any kind of topic, for programs that treat all topics alike.

use super::memory::{self, WriterLock};
use super::retry::Refusal;
use super::service::{self, Ends, Missing, PubSub};
use crate::bus::{Bus, TopicInfo};
use crate::error::WireError;
use crate::keyexpr::KeyExpr;
use crate::layout::{
    Command, Estimate, FIELD_SLOTS, FieldHeader, Grasp, Health, LAYOUT_VERSION, Payload, SensorSample,
    Setpoint, State, Target, Valve, View,
};
use crate::qos;
use crate::sys::{Ipc, now_ns};
use crate::topic::{Topic, TopicKind};
use crate::wake::{Wakeable, Waker, Waking};
use iceoryx2::port::ReceiveError;
use iceoryx2::port::publisher::{Publisher, PublisherCreateError};
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::port::{notifier::Notifier, subscriber::Subscriber};
use iceoryx2::prelude::{AllocationStrategy, BackpressureStrategy, IceoryxSend, ZeroCopySend};
use iceoryx2::sample::Sample;
use iceoryx2::sample_mut::SampleMut;
use std::fmt::Debug;
use std::rc::Rc;

/// Content of a topic's samples: a payload, or `[f32]` behind a [`FieldHeader`].
pub trait TopicContent: Debug + IceoryxSend + 'static {
    /// Header of a sample.
    type Header: Debug + ZeroCopySend + 'static;

    #[doc(hidden)]
    fn service(bus: &Bus, topic: &Topic, missing: Missing) -> Result<PubSub<Self, Self::Header>, WireError>;

    #[doc(hidden)]
    fn publisher(
        service: &PubSub<Self, Self::Header>,
        qos: qos::Qos,
        entries: usize,
    ) -> Result<Publisher<Ipc, Self, Self::Header>, PublisherCreateError>;

    #[doc(hidden)]
    fn receive(subscriber: &Subscriber<Ipc, Self, Self::Header>) -> Received<Self>;
}

/// A sample, if one waits.
type Received<P> = Result<Option<Sample<Ipc, P, <P as TopicContent>::Header>>, ReceiveError>;

impl<P: Payload> TopicContent for P {
    type Header = ();

    fn service(bus: &Bus, topic: &Topic, missing: Missing) -> Result<PubSub<P, ()>, WireError> {
        service::sized(bus, topic, missing)
    }

    fn publisher(
        service: &PubSub<P, ()>,
        qos: qos::Qos,
        _entries: usize,
    ) -> Result<Publisher<Ipc, P, ()>, PublisherCreateError> {
        service
            .publisher_builder()
            .max_loaned_samples(qos.max_loans)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .override_sample_preallocation(move |worst| worst.min(qos.samples_in_use()))
            .create()
    }

    fn receive(subscriber: &Subscriber<Ipc, Self, Self::Header>) -> Received<Self> {
        subscriber.receive()
    }
}

impl TopicContent for [f32] {
    type Header = FieldHeader;

    fn service(bus: &Bus, topic: &Topic, missing: Missing) -> Result<PubSub<[f32], FieldHeader>, WireError> {
        service::slices(bus, topic, missing)
    }

    fn publisher(
        service: &PubSub<[f32], FieldHeader>,
        qos: qos::Qos,
        entries: usize,
    ) -> Result<Publisher<Ipc, [f32], FieldHeader>, PublisherCreateError> {
        service
            .publisher_builder()
            .initial_max_slice_len(entries)
            .allocation_strategy(AllocationStrategy::Static)
            .max_loaned_samples(qos.max_loans)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .override_sample_preallocation(move |worst| worst.min(qos.samples_in_use()))
            .create()
    }

    fn receive(subscriber: &Subscriber<Ipc, Self, Self::Header>) -> Received<Self> {
        subscriber.receive()
    }
}

/// The ports of the one writer of a topic.
#[derive(Debug)]
struct WriterPort<P: TopicContent + ?Sized> {
    topic: Topic,
    publisher: Publisher<Ipc, P, P::Header>,
    notifier: Notifier<Ipc>,
    // Last: released after the ports.
    _lock: WriterLock,
}

impl<P: TopicContent + ?Sized> WriterPort<P> {
    /// Becomes the writer and reserves all memory.
    fn create(bus: &Bus, topic: &Topic, owner: &str, entries: usize) -> Result<Self, WireError> {
        service::require_place(bus, topic)?;
        let lock = service::retry(bus, topic.name(), || WriterLock::take(&bus.places, topic.name(), owner))?;
        let qos = qos::of(topic.kind());
        let service = P::service(bus, topic, Missing::Create)?;
        let publisher = service::retry(bus, topic.name(), || {
            P::publisher(&service, qos, entries).map_err(|error| writer_failed(bus, topic, error))
        })?;
        memory::reserve(&bus.places, topic, publisher.id().value())?;
        let notifier = service::notifier(bus, topic)?;
        Ok(Self { topic: topic.clone(), publisher, notifier, _lock: lock })
    }

    fn loan_failed(&self, error: impl Debug) -> WireError {
        WireError::Loan { topic: self.topic.name().into(), cause: format!("{error:?}") }
    }

    fn send_failed(&self, error: impl Debug) -> WireError {
        WireError::Send { topic: self.topic.name().into(), cause: format!("{error:?}") }
    }

    fn notify(&self) -> Result<(), WireError> {
        self.notifier.notify().map(drop).map_err(|error| self.send_failed(error))
    }
}

/// The one writer of a topic with a payload of fixed size.
#[derive(Debug)]
pub struct Writer<P: Payload>(WriterPort<P>);

/// One of many readers of a topic. Dropping it frees its slot.
#[derive(Debug)]
pub struct Reader<P: TopicContent + ?Sized> {
    topic: Topic,
    subscriber: Subscriber<Ipc, P, P::Header>,
    waker: Waker,
}

/// Sends readings.
pub type SensorWriter = Writer<SensorSample>;
/// Receives readings.
pub type SensorReader = Reader<SensorSample>;
/// Sends states.
pub type StateWriter = Writer<State>;
/// Receives states.
pub type StateReader = Reader<State>;
/// Sends health.
pub type HealthWriter = Writer<Health>;
/// Receives health.
pub type HealthReader = Reader<Health>;
/// Sends grasps.
pub type GraspWriter = Writer<Grasp>;
/// Receives grasps.
pub type GraspReader = Reader<Grasp>;
/// Sends estimates.
pub type EstimateWriter = Writer<Estimate>;
/// Receives estimates.
pub type EstimateReader = Reader<Estimate>;
/// Sends pressure commands.
pub type CommandWriter = Writer<Command>;
/// Receives pressure commands.
pub type CommandReader = Reader<Command>;
/// Sends setpoints or overrides, under the owner's name.
pub type SetpointWriter = Writer<Setpoint>;
/// Receives setpoints or overrides, under the owner's name.
pub type SetpointReader = Reader<Setpoint>;
/// Sends targets, under the owner's name.
pub type TargetWriter = Writer<Target>;
/// Receives targets, under the owner's name.
pub type TargetReader = Reader<Target>;
/// Sends the values written to a valve.
pub type ValveWriter = Writer<Valve>;
/// Receives the values written to a valve.
pub type ValveReader = Reader<Valve>;
/// Receives fields.
pub type FieldReader = Reader<[f32]>;

impl<P: Payload> Writer<P> {
    /// Becomes the writer of `topic` and reserves all its memory.
    ///
    /// # Errors
    /// [`WireError::TooManyTopics`], [`WireError::AlreadyPublished`] when a living process writes already, [`WireError::NoMemory`] when /dev/shm is
    /// full, [`WireError::Incompatible`] when a program of another version made the topic.
    pub fn create(bus: &Bus, topic: &Topic) -> Result<Self, WireError> {
        Self::create_named(bus, topic, "")
    }

    /// [`Self::create`] under a name, which the error of a second writer contains.
    ///
    /// # Errors
    /// As [`Self::create`].
    pub fn create_named(bus: &Bus, topic: &Topic, owner: &str) -> Result<Self, WireError> {
        WriterPort::create(bus, topic, owner, 0).map(Self)
    }

    /// Sends one sample and wakes the readers. Cost: under a microsecond, and 5-8 us per waiting reader to wake it.
    ///
    /// # Errors
    /// [`WireError::Loan`] when no sample is free, [`WireError::Send`] when the port broke.
    pub fn publish(&mut self, value: P) -> Result<(), WireError> {
        let port = &self.0;
        let sample = port.publisher.loan_uninit().map_err(|error| port.loan_failed(error))?;
        sample.write_payload(value).send().map_err(|error| port.send_failed(error))?;
        port.notify()
    }

    /// Sends the topic's history to readers that came since the last sample; [`Self::publish`] does so as well. For writers that
    /// may have nothing to send for a while.
    ///
    /// # Errors
    /// [`WireError::Send`] when a reader could not be connected.
    pub fn serve_late_readers(&self) -> Result<(), WireError> {
        self.0.publisher.update_connections().map_err(|error| self.0.send_failed(error))
    }

    /// The topic.
    pub fn topic(&self) -> &Topic {
        &self.0.topic
    }
}

impl<P: TopicContent + ?Sized> Reader<P> {
    /// Reads a topic that must exist.
    ///
    /// # Errors
    /// [`WireError::NoSuchTopic`] when it does not exist, [`WireError::Incompatible`] when a program of another version made
    /// it, [`WireError::TooManyReaders`].
    pub fn open(bus: &Bus, topic: &Topic) -> Result<Self, WireError> {
        Self::build(bus, topic, Missing::Refuse, Waking::ByEvent)
    }

    /// Reads a topic that may come into being later.
    ///
    /// # Errors
    /// As [`Self::open`], without `NoSuchTopic`.
    pub fn attach(bus: &Bus, topic: &Topic) -> Result<Self, WireError> {
        Self::attach_as(bus, topic, Waking::ByEvent)
    }

    /// As [`Self::attach`], woken or not.
    ///
    /// # Errors
    /// As [`Self::attach`].
    pub fn attach_as(bus: &Bus, topic: &Topic, waking: Waking) -> Result<Self, WireError> {
        Self::build(bus, topic, Missing::Create, waking)
    }

    fn build(bus: &Bus, topic: &Topic, missing: Missing, waking: Waking) -> Result<Self, WireError> {
        let service = P::service(bus, topic, missing)?;
        let Ends { subscriber, waker } = service::reader(bus, topic, &service, waking)?;
        Ok(Self { topic: topic.clone(), subscriber, waker })
    }

    fn receive(&self) -> Result<Option<Sample<Ipc, P, P::Header>>, WireError> {
        P::receive(&self.subscriber).map_err(|error| self.receive_failed(error))
    }

    fn receive_failed(&self, error: impl Debug) -> WireError {
        WireError::Receive { topic: self.topic.name().into(), cause: format!("{error:?}") }
    }

    /// The topic.
    pub fn topic(&self) -> &Topic {
        &self.topic
    }
}

impl<P: Payload> Reader<P> {
    /// The oldest waiting sample, if there is one. Never blocks.
    ///
    /// # Errors
    /// [`WireError::Receive`] when a connection broke.
    pub fn next(&self) -> Result<Option<P>, WireError> {
        Ok(self.receive()?.map(|sample| *sample.payload()))
    }

    /// The newest waiting sample; the older ones are discarded. Never blocks.
    ///
    /// # Errors
    /// As [`Self::next`].
    pub fn newest(&self) -> Result<Option<P>, WireError> {
        let mut newest = None;
        while let Some(sample) = self.next()? {
            newest = Some(sample);
        }
        Ok(newest)
    }
}

impl Reader<[f32]> {
    /// The oldest waiting field, if there is one. Never blocks, copies nothing.
    ///
    /// # Errors
    /// [`WireError::Receive`] when a connection broke or too many samples are held, [`WireError::FieldShape`] when header
    /// and payload contradict each other.
    pub fn next(&self) -> Result<Option<FieldSample>, WireError> {
        let Some(sample) = self.receive()? else { return Ok(None) };
        check_shape(&self.topic, sample.user_header(), sample.payload().len())?;
        Ok(Some(FieldSample { sample }))
    }

    /// The newest waiting field; older ones are given back. Never blocks.
    ///
    /// # Errors
    /// As [`Self::next`].
    pub fn newest(&self) -> Result<Option<FieldSample>, WireError> {
        // A sample is given back before the next is taken: a reader that already holds all but one of the samples it
        // may hold still receives the newest.
        loop {
            let Some(sample) = self.next()? else { return Ok(None) };
            if !self.subscriber.has_samples().map_err(|error| self.receive_failed(error))? {
                return Ok(Some(sample));
            }
        }
    }
}

impl<P: TopicContent + ?Sized> Wakeable for Reader<P> {
    fn waker(&self) -> Waker {
        self.waker.clone()
    }
}

/// The one writer of a field topic.
#[derive(Debug)]
pub struct FieldWriter {
    bus: Bus,
    entries: usize,
    /// Shared with the loans, which are sent through it.
    port: Rc<WriterPort<[f32]>>,
}

/// A sample on loan: memory that all readers map once it is sent. Dropping it unsent gives it back.
#[derive(Debug)]
pub struct FieldLoan {
    sample: SampleMut<Ipc, [f32], FieldHeader>,
    port: Rc<WriterPort<[f32]>>,
}

/// A received field in shared memory, unchanged until this is dropped. A reader may hold at most
/// [`qos::Qos::max_borrowed`] of them.
#[derive(Debug)]
pub struct FieldSample {
    sample: Sample<Ipc, [f32], FieldHeader>,
}

impl FieldWriter {
    /// Becomes the writer of `topic` with samples of `entries` values, and reserves all its memory:
    /// [`qos::Qos::samples_in_use`] x 4 x `entries` bytes.
    ///
    /// # Errors
    /// As [`Writer::create`].
    pub fn create(bus: &Bus, topic: &Topic, entries: usize) -> Result<Self, WireError> {
        let port = WriterPort::create(bus, topic, "", entries)?;
        Ok(Self { bus: bus.clone(), entries, port: Rc::new(port) })
    }

    /// Takes a free sample of the full length. Its values are those of an earlier field: write all of them.
    ///
    /// # Errors
    /// [`WireError::Loan`] when no sample is free.
    pub fn loan(&self) -> Result<FieldLoan, WireError> {
        let loaned = self.port.publisher.loan_slice_uninit(self.entries);
        let sample = loaned.map_err(|error| self.port.loan_failed(error))?;
        // SAFETY: the memory is a shared mapping that the operating system handed out zeroed and that only `f32` are written to;
        // every bit pattern is a valid `f32`, so the values are initialised.
        let sample = unsafe { sample.assume_init() };
        Ok(FieldLoan { sample, port: self.port.clone() })
    }

    /// Maps all pages into this process ahead of use; returns the bytes.
    ///
    /// # Errors
    /// I/O errors of reading the mappings.
    pub fn prefault(&self) -> std::io::Result<u64> {
        memory::prefault(&self.bus.places, self.port.publisher.id().value())
    }

    /// The topic.
    pub fn topic(&self) -> &Topic {
        &self.port.topic
    }

    /// Values of a sample.
    pub fn entries(&self) -> usize {
        self.entries
    }
}

impl FieldLoan {
    /// The values to write.
    pub fn values_mut(&mut self) -> &mut [f32] {
        self.sample.payload_mut()
    }

    /// Stamps and sends the field, then wakes the readers. Returns the publish stamp.
    ///
    /// # Errors
    /// [`WireError::FieldShape`] when the header does not describe the payload, [`WireError::Send`] when the port broke.
    pub fn send(mut self, header: FieldHeader) -> Result<u64, WireError> {
        let port = &self.port;
        check_shape(&port.topic, &header, self.sample.payload().len())?;
        let t_publish_ns = now_ns();
        *self.sample.user_header_mut() = FieldHeader { t_publish_ns, ..header };
        self.sample.send().map_err(|error| port.send_failed(error))?;
        port.notify()?;
        Ok(t_publish_ns)
    }
}

impl FieldSample {
    /// The header.
    pub fn header(&self) -> &FieldHeader {
        self.sample.user_header()
    }

    /// All values, field-major.
    pub fn values(&self) -> &[f32] {
        self.sample.payload()
    }

    /// One field (a number of [`crate::layout::field_id`]), one value per node; `None` when it is not in this sample.
    pub fn field(&self, id: u8) -> Option<&[f32]> {
        self.header().column(self.values(), id)
    }
}

/// Checked by the writer before sending and by the reader after receiving.
fn check_shape(topic: &Topic, header: &FieldHeader, found: usize) -> Result<(), WireError> {
    let fits = header.entries() == found as u64
        && header.layout_version == LAYOUT_VERSION
        && header.field_count as usize <= FIELD_SLOTS;
    if fits {
        return Ok(());
    }
    Err(WireError::FieldShape {
        topic: topic.name().into(),
        found,
        nodes: header.node_count,
        fields: header.field_count,
    })
}

/// A writer was refused. A dead writer's place is freed by the clean-up; only a living one is a contradiction.
fn writer_failed(bus: &Bus, topic: &Topic, error: PublisherCreateError) -> Refusal {
    match error {
        PublisherCreateError::ExceedsMaxSupportedPublishers => {
            let writers = participants(bus, topic).map(|(writers, _)| writers).unwrap_or_default();
            let holder = writers.first().map(|pid| format!(" (process {pid})")).unwrap_or_default();
            Refusal::Full(WireError::AlreadyPublished { topic: topic.name().into(), holder })
        }
        other => Refusal::Final(WireError::Open { topic: topic.name().into(), cause: format!("{other:?}") }),
    }
}

impl Bus {
    /// All topics whose name `key` matches, sorted by name, with their writers and readers. Each is opened for a moment, which
    /// writes to the management folder: a busy disk may delay the caller by seconds.
    ///
    /// # Errors
    /// As [`Self::names`].
    pub fn topics(&self, key: &KeyExpr) -> Result<Vec<TopicInfo>, WireError> {
        let mut found = self.listed(key)?;
        for info in &mut found {
            // A topic that vanishes after the listing has no participants.
            if let Ok((writers, readers)) = participants(self, &info.topic) {
                info.writers = writers;
                info.readers = readers;
            }
        }
        Ok(found)
    }
}

// ---- any kind of topic ----

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

        /// Process ids of writers and readers of a topic.
        fn participants(bus: &Bus, topic: &Topic) -> Result<(Vec<u32>, Vec<u32>), WireError> {
            Ok(match topic.kind() {
                $(TopicKind::$kind => {
                    service::processes(&service::sized::<$payload>(bus, topic, Missing::Refuse)?)
                })+
                TopicKind::Field => service::processes(&service::slices(bus, topic, Missing::Refuse)?),
            })
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
