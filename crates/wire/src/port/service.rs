//! Opening services: one builder per kind of topic, errors a person understands.

use super::retry::{Refusal, within};
use crate::bus::Bus;
use crate::sys::Ipc;
use crate::wake::{Waker, Waking};
use crate::{Topic, TopicKind, WireError, layout, qos};
use iceoryx2::port::listener::{Listener, ListenerCreateError};
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::subscriber::{Subscriber, SubscriberCreateError};
use iceoryx2::prelude::*;
use iceoryx2::service::builder::event::{EventOpenError, EventOpenOrCreateError};
use iceoryx2::service::builder::publish_subscribe::{
    Builder, PublishSubscribeOpenError as OpenError, PublishSubscribeOpenOrCreateError as OpenOrCreateError,
};
use iceoryx2::service::port_factory::{event, publish_subscribe};
use std::fmt::Debug;
use std::sync::{Mutex, PoisonError};

/// Whether a missing topic is made or reported.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Missing {
    Create,
    Refuse,
}

pub type PubSub<P, H> = publish_subscribe::PortFactory<Ipc, P, H>;
pub(crate) type Events = event::PortFactory<Ipc>;
/// The ports of a reader.
pub(crate) struct Ends<P: Debug + IceoryxSend + ?Sized + 'static, H: Debug + ZeroCopySend + 'static> {
    pub(crate) subscriber: Subscriber<Ipc, P, H>,
    pub(crate) waker: Waker,
}

/// The publish-subscribe service of a topic with a fixed-size payload.
pub(crate) fn sized<P: Debug + ZeroCopySend>(
    bus: &Bus,
    topic: &Topic,
    missing: Missing,
) -> Result<PubSub<P, ()>, WireError> {
    let name = service_name(topic.name())?;
    retry(bus, topic.name(), || {
        let builder = with_qos(bus.node().service_builder(&name).publish_subscribe::<P>(), topic.kind());
        match missing {
            Missing::Create => builder.open_or_create().map_err(|error| open_or_create_failed(topic, error)),
            Missing::Refuse => builder.open().map_err(|error| open_failed(topic, error)),
        }
    })
}

/// The publish-subscribe service of a field topic.
pub(crate) fn slices(
    bus: &Bus,
    topic: &Topic,
    missing: Missing,
) -> Result<PubSub<[f32], layout::FieldHeader>, WireError> {
    let name = service_name(topic.name())?;
    retry(bus, topic.name(), || {
        let builder = bus.node().service_builder(&name).publish_subscribe::<[f32]>();
        let builder = with_qos(builder.user_header::<layout::FieldHeader>(), topic.kind());
        match missing {
            Missing::Create => builder.open_or_create().map_err(|error| open_or_create_failed(topic, error)),
            Missing::Refuse => builder.open().map_err(|error| open_failed(topic, error)),
        }
    })
}

/// The event service that wakes a topic's readers. It has no deadline on purpose: with one, `notify` fails in the writer
/// although it has delivered. Deadlines are the reader's.
pub(crate) fn events(bus: &Bus, topic: &Topic) -> Result<Events, WireError> {
    let qos = qos::of(topic.kind());
    let shape = EventShape { listeners: qos.max_readers, notifiers: qos::MAX_WRITERS, nodes: qos.max_nodes };
    named_events(bus, topic.name(), shape)
}

/// How many may take part in an event service.
#[derive(Debug, Clone, Copy)]
pub(crate) struct EventShape {
    pub listeners: usize,
    pub notifiers: usize,
    pub nodes: usize,
}

/// An event service by name.
pub(crate) fn named_events(bus: &Bus, name: &str, shape: EventShape) -> Result<Events, WireError> {
    let service = service_name(name)?;
    retry(bus, name, || {
        bus.node()
            .service_builder(&service)
            .event()
            .max_listeners(shape.listeners)
            .max_notifiers(shape.notifiers)
            .max_nodes(shape.nodes)
            .event_id_max_value(1)
            .open_or_create()
            .map_err(|error| match error {
                EventOpenOrCreateError::EventOpenError(EventOpenError::ExceedsMaxNumberOfNodes) => {
                    Refusal::Full(WireError::TooManyPrograms { name: name.to_owned(), limit: shape.nodes })
                }
                other => Refusal::Passing(format!("{other:?}")),
            })
    })
}

fn with_qos<P: Debug + IceoryxSend + ?Sized, H: Debug + ZeroCopySend>(
    builder: Builder<P, H, Ipc>,
    kind: TopicKind,
) -> Builder<P, H, Ipc> {
    let qos = qos::of(kind);
    builder
        .max_publishers(qos::MAX_WRITERS)
        .max_subscribers(qos.max_readers)
        .max_nodes(qos.max_nodes)
        .subscriber_max_buffer_size(qos.buffer)
        .subscriber_max_borrowed_samples(qos.max_borrowed)
        .history_size(qos.history)
        .enable_safe_overflow(true)
}

/// Refuses a new topic in a full shared-memory domain.
pub(crate) fn require_place(bus: &Bus, topic: &Topic) -> Result<(), WireError> {
    if bus.places.service_files().len() < 2 * qos::MAX_TOPICS {
        return Ok(());
    }
    let name = service_name(topic.name())?;
    match Ipc::does_exist(&name, &bus.places.config, MessagingPattern::PublishSubscribe) {
        Ok(true) => Ok(()),
        _ => Err(WireError::TooManyTopics { topic: topic.name().to_owned(), limit: qos::MAX_TOPICS }),
    }
}

/// A reader's two ends. The listener comes first: a sample sent in between then wakes us for nothing instead of never.
pub(crate) fn reader<P: Debug + IceoryxSend + ?Sized + 'static, H: Debug + ZeroCopySend + 'static>(
    bus: &Bus,
    topic: &Topic,
    service: &PubSub<P, H>,
    waking: Waking,
) -> Result<Ends<P, H>, WireError> {
    let qos = qos::of(topic.kind());
    let listener = match waking {
        Waking::ByEvent => Some(listener(bus, topic)?),
        Waking::Never => None,
    };
    let subscriber = retry(bus, topic.name(), || {
        let builder = service.subscriber_builder().buffer_size(qos.buffer).history_request(qos.history);
        builder.create().map_err(|error| reader_failed(topic, error))
    })?;
    Ok(Ends { subscriber, waker: Waker::new(listener) })
}

pub(crate) fn service_name(name: &str) -> Result<ServiceName, WireError> {
    ServiceName::new(name)
        .map_err(|error| WireError::Open { topic: name.into(), cause: format!("{error:?}") })
}

/// As [`within`], for a program with an open bus.
pub(crate) fn retry<T>(
    bus: &Bus,
    name: &str,
    attempt: impl FnMut() -> Result<T, Refusal>,
) -> Result<T, WireError> {
    within(&bus.places, name, attempt)
}

fn open_or_create_failed(topic: &Topic, error: OpenOrCreateError) -> Refusal {
    match error {
        OpenOrCreateError::PublishSubscribeOpenError(error) => open_failed(topic, error),
        other => Refusal::Passing(format!("{other:?}")),
    }
}

fn open_failed(topic: &Topic, error: OpenError) -> Refusal {
    let topic_name = topic.name().to_owned();
    let cause = format!("{error:?}");
    match error {
        OpenError::DoesNotExist => Refusal::Final(WireError::NoSuchTopic { topic: topic_name }),
        OpenError::IncompatibleTypes
        | OpenError::IncompatibleMessagingPattern
        | OpenError::IncompatibleAttributes
        | OpenError::IncompatibleOverflowBehavior
        | OpenError::DoesNotSupportRequestedMinBufferSize
        | OpenError::DoesNotSupportRequestedMinHistorySize
        | OpenError::DoesNotSupportRequestedMinSubscriberBorrowedSamples
        | OpenError::DoesNotSupportRequestedAmountOfPublishers
        | OpenError::DoesNotSupportRequestedAmountOfSubscribers
        | OpenError::DoesNotSupportRequestedAmountOfNodes
        | OpenError::VersionMismatch => Refusal::Final(WireError::Incompatible { topic: topic_name, cause }),
        OpenError::ExceedsMaxNumberOfNodes => {
            let limit = qos::of(topic.kind()).max_nodes;
            Refusal::Full(WireError::TooManyPrograms { name: topic_name, limit })
        }
        _ => Refusal::Passing(cause),
    }
}

/// A reader was refused.
fn reader_failed(topic: &Topic, error: SubscriberCreateError) -> Refusal {
    match error {
        SubscriberCreateError::ExceedsMaxSupportedSubscribers => Refusal::Full(too_many_readers(topic)),
        other => Refusal::Final(WireError::Open { topic: topic.name().into(), cause: format!("{other:?}") }),
    }
}

fn too_many_readers(topic: &Topic) -> WireError {
    WireError::TooManyReaders { topic: topic.name().into(), limit: qos::of(topic.kind()).max_readers }
}

/// Process ids of writers and readers of a service.
pub(super) fn processes<P, H>(service: &PubSub<P, H>) -> (Vec<u32>, Vec<u32>)
where
    P: Debug + IceoryxSend + ?Sized,
    H: Debug + ZeroCopySend,
{
    let (mut writers, mut readers) = (Vec::new(), Vec::new());
    let config = service.dynamic_config();
    config.list_publishers(|port| {
        writers.extend(port.node_id.pid::<Ipc>().map(|pid| pid.value() as u32).ok());
        CallbackProgression::Continue
    });
    config.list_subscribers(|port| {
        readers.extend(port.node_id.pid::<Ipc>().map(|pid| pid.value() as u32).ok());
        CallbackProgression::Continue
    });
    (writers, readers)
}

/// The port that wakes a topic's readers.
pub(crate) fn notifier(bus: &Bus, topic: &Topic) -> Result<Notifier<Ipc>, WireError> {
    let service = events(bus, topic)?;
    retry(bus, topic.name(), || {
        service.notifier_builder().create().map_err(|error| Refusal::Passing(format!("{error:?}")))
    })
}

/// The listener of an event service. iceoryx2 sets the process's umask while it binds a listener's socket: of two threads at a time,
/// one would restore the other's, and all later files and folders of the process would be without their owner's rights.
pub(crate) fn bind(events: &Events) -> Result<Listener<Ipc>, ListenerCreateError> {
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
    let _held = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    events.listener_builder().create()
}

/// The port that a topic's reader is woken by.
fn listener(bus: &Bus, topic: &Topic) -> Result<Listener<Ipc>, WireError> {
    let service = events(bus, topic)?;
    retry(bus, topic.name(), || {
        bind(&service).map_err(|error| match error {
            ListenerCreateError::ExceedsMaxSupportedListeners => Refusal::Full(too_many_readers(topic)),
            other => Refusal::Passing(format!("{other:?}")),
        })
    })
}
