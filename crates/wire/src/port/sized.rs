//! Ports of topics with a payload of fixed size: everything but fields.

use super::segment;
use super::service::{self, Missing};
use super::writer_lock::WriterLock;
use crate::bus::Bus;
use crate::error::WireError;
use crate::layout::{Command, Estimate, Grasp, Health, Payload, SensorSample, Setpoint, State, Valve};
use crate::qos;
use crate::topic::Topic;
use crate::transport::Ipc;
use crate::wake::{Wakeable, Waker, Waking};
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::port::{notifier::Notifier, publisher::Publisher, subscriber::Subscriber};
use iceoryx2::prelude::BackpressureStrategy;

/// The one writer of a topic.
#[derive(Debug)]
pub struct Writer<P: Payload> {
    topic: Topic,
    publisher: Publisher<Ipc, P, ()>,
    notifier: Notifier<Ipc>,
    // Last: given back after the ports are.
    _lock: WriterLock,
}

/// One of many readers of a topic. Dropping it gives its slot back.
#[derive(Debug)]
pub struct Reader<P: Payload> {
    topic: Topic,
    subscriber: Subscriber<Ipc, P, ()>,
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
/// Receives setpoints or overrides.
pub type SetpointReader = Reader<Setpoint>;
/// Sends what a valve was told.
pub type ValveWriter = Writer<Valve>;
/// Receives what a valve was told.
pub type ValveReader = Reader<Valve>;

impl<P: Payload> Writer<P> {
    /// Becomes the writer of `topic` and reserves all its memory.
    ///
    /// # Errors
    /// [`WireError::AlreadyPublished`] when a living process writes already, [`WireError::NoMemory`] when /dev/shm is
    /// full, [`WireError::Incompatible`] when a program of another version made the topic.
    pub fn create(bus: &Bus, topic: &Topic) -> Result<Self, WireError> {
        Self::create_named(bus, topic, "")
    }

    /// [`Self::create`] under a name, by which a second writer is told who writes already.
    ///
    /// # Errors
    /// As [`Self::create`].
    pub fn create_named(bus: &Bus, topic: &Topic, owner: &str) -> Result<Self, WireError> {
        let lock = service::retry(bus, topic.name(), || WriterLock::take(&bus.places, topic.name(), owner))?;
        let qos = qos::of(topic.kind());
        let service = service::sized::<P>(bus, topic, Missing::Create)?;
        let publisher = service::retry(bus, topic.name(), || {
            service
                .publisher_builder()
                .max_loaned_samples(qos.max_loans)
                .backpressure_strategy(BackpressureStrategy::DiscardData)
                .override_sample_preallocation(move |worst| worst.min(qos.samples_in_use()))
                .create()
                .map_err(|error| service::writer_failed(bus, topic, error))
        })?;
        segment::reserve(&bus.places, topic, publisher.id().value())?;
        let notifier = service::notifier(bus, topic)?;
        Ok(Self { topic: topic.clone(), publisher, notifier, _lock: lock })
    }

    /// Sends one sample and wakes the readers. Cost: under a microsecond, and 5-8 us per waiting reader to wake it.
    ///
    /// # Errors
    /// [`WireError::Loan`] when no sample is free, [`WireError::Send`] when the port broke.
    pub fn publish(&mut self, value: P) -> Result<(), WireError> {
        let sample = self.publisher.loan_uninit().map_err(|error| WireError::Loan {
            topic: self.topic.name().into(),
            cause: format!("{error:?}"),
        })?;
        let failed = |cause: String| WireError::Send { topic: self.topic.name().to_owned(), cause };
        sample.write_payload(value).send().map_err(|error| failed(format!("{error:?}")))?;
        self.notifier.notify().map_err(|error| failed(format!("{error:?}")))?;
        Ok(())
    }

    /// Gives readers that came since the last sample what the topic keeps for late ones; [`Self::publish`] does so as well.
    /// For writers that may have nothing to send for a while.
    ///
    /// # Errors
    /// [`WireError::Send`] when a reader could not be connected.
    pub fn serve_late_readers(&self) -> Result<(), WireError> {
        let failed = |cause| WireError::Send { topic: self.topic.name().to_owned(), cause };
        self.publisher.update_connections().map_err(|error| failed(format!("{error:?}")))
    }

    /// The topic.
    pub fn topic(&self) -> &Topic {
        &self.topic
    }
}

impl<P: Payload> Reader<P> {
    /// Reads a topic that must exist.
    ///
    /// # Errors
    /// [`WireError::NoSuchTopic`] when nobody made it, [`WireError::Incompatible`] when a program of another version did,
    /// [`WireError::TooManyReaders`].
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
        let service = service::sized::<P>(bus, topic, missing)?;
        let (subscriber, waker) = service::reader(bus, topic, &service, waking)?;
        Ok(Self { topic: topic.clone(), subscriber, waker })
    }

    /// The oldest waiting sample, if there is one. Never blocks.
    ///
    /// # Errors
    /// [`WireError::Receive`] when a connection broke.
    pub fn next(&self) -> Result<Option<P>, WireError> {
        let received = self.subscriber.receive().map_err(|error| WireError::Receive {
            topic: self.topic.name().into(),
            cause: format!("{error:?}"),
        })?;
        Ok(received.map(|sample| *sample.payload()))
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

    /// Whether a sample waits; not where that cannot be told: [`Self::next`] says why. Never blocks, takes nothing.
    pub fn has_next(&self) -> bool {
        self.subscriber.has_samples().unwrap_or(false)
    }

    /// The topic.
    pub fn topic(&self) -> &Topic {
        &self.topic
    }
}

impl<P: Payload> Wakeable for Reader<P> {
    fn waker(&self) -> Waker {
        self.waker.clone()
    }
}
