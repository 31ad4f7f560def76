//! Opening services: one builder per kind of topic, bounded retries while others create or remove the same resource, errors a person
//! understands.

use super::topic::participants;
use crate::bus::Bus;
use crate::leftover::Places;
use crate::sys::{Ipc, SHM_DIR};
use crate::wake::{Waker, Waking};
use crate::{KeyExpr, Topic, TopicInfo, TopicKind, WireError, layout, qos};
use iceoryx2::port::listener::{Listener, ListenerCreateError};
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::PublisherCreateError;
use iceoryx2::port::subscriber::{Subscriber, SubscriberCreateError};
use iceoryx2::prelude::*;
use iceoryx2::service::builder::event::{EventOpenError, EventOpenOrCreateError};
use iceoryx2::service::builder::publish_subscribe::{
    Builder, PublishSubscribeOpenError as OpenError, PublishSubscribeOpenOrCreateError as OpenOrCreateError,
};
use iceoryx2::service::port_factory::{event, publish_subscribe};
use std::fmt::Debug;
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

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

/// A writer was refused. A dead writer's place is freed by the clean-up; only a living one is a contradiction.
pub(crate) fn writer_failed(bus: &Bus, topic: &Topic, error: PublisherCreateError) -> Refusal {
    match error {
        PublisherCreateError::ExceedsMaxSupportedPublishers => {
            let writers = participants(bus, topic).map(|(writers, _)| writers).unwrap_or_default();
            let holder = writers.first().map(|pid| format!(" (process {pid})")).unwrap_or_default();
            Refusal::Full(WireError::AlreadyPublished { topic: topic.name().into(), holder })
        }
        other => Refusal::Final(WireError::Open { topic: topic.name().into(), cause: format!("{other:?}") }),
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

// ---- retries ----

/// How long to wait for others who create or remove the same topic.
const FLUX_TIMEOUT: Duration = Duration::from_secs(2);
/// How long a program whose place is taken waits for others that are just creating something, to remove leftovers then.
const SWEEP_PATIENCE: Duration = Duration::from_millis(200);
/// Pause between tries; the others need a few hundred microseconds.
const FLUX_PAUSE: Duration = Duration::from_millis(2);

/// Why a try failed.
pub(crate) enum Refusal {
    /// For good.
    Final(WireError),
    /// For good, unless the places that are taken are those of dead programs.
    Full(WireError),
    /// Because another program is creating or removing resources, or died while doing so.
    Passing(String),
}

/// Tries until success, a final refusal, or [`FLUX_TIMEOUT`]. What dead programs left is removed between two tries.
pub(crate) fn within<T>(
    places: &Places,
    name: &str,
    mut attempt: impl FnMut() -> Result<T, Refusal>,
) -> Result<T, WireError> {
    let begin = Instant::now();
    let mut tries = 0;
    loop {
        tries += 1;
        let tried = locked(places, &mut attempt)?;
        let refusal = match tried {
            Ok(done) => return Ok(done),
            Err(Refusal::Final(WireError::NoSuchTopic { topic })) => {
                return Err(WireError::NoSuchTopic { topic });
            }
            Err(refusal) => refusal,
        };
        if let Some(error) = exhausted_resource(name, places) {
            return Err(error);
        }
        let over = begin.elapsed() > FLUX_TIMEOUT;
        match refusal {
            Refusal::Final(error) => return Err(error),
            Refusal::Full(error) if over || !places.sweep(SWEEP_PATIENCE).any() => return Err(error),
            Refusal::Passing(cause) if over => {
                return Err(WireError::InFlux { topic: name.into(), tries, cause });
            }
            Refusal::Full(_) => {}
            Refusal::Passing(_) => {
                places.sweep(FLUX_PAUSE);
                std::thread::sleep(FLUX_PAUSE);
            }
        }
    }
}

/// One try under the start lock, which keeps other programs from removing our incomplete resources.
fn locked<T>(
    places: &Places,
    attempt: impl FnOnce() -> Result<T, Refusal>,
) -> Result<Result<T, Refusal>, WireError> {
    let path = || places.lock_path().display().to_string();
    let lock = places.lock_to_create(FLUX_TIMEOUT).map_err(|error| {
        let cause = format!("{}: {error}", path());
        exhausted_resource(&path(), places).unwrap_or(WireError::Node { cause })
    })?;
    let waited_ms = FLUX_TIMEOUT.as_millis() as u64;
    let _lock = lock.ok_or_else(|| WireError::StartLocked { path: path(), waited_ms })?;
    Ok(match places.empty_segment() {
        Some(path) => Err(Refusal::Passing(format!(
            "{} has no size: it is being made, or was truncated",
            path.display()
        ))),
        None => attempt(),
    })
}

// ---- which resource is exhausted: iceoryx2 reports all of them as an internal failure ----

/// Names what is used up; `None`: it was something else.
fn exhausted_resource(name: &str, places: &Places) -> Option<WireError> {
    // Shared memory that is full is named where it is reserved, with the bytes that are missing.
    too_many_files(name)
        .or_else(|| full(name, &places.root, true))
        .or_else(|| full(name, Path::new(SHM_DIR), false))
}

/// Files that making one port may have open at the same time. What failed has closed its own again.
const FILES_OF_A_PORT: usize = 16;

fn too_many_files(name: &str) -> Option<WireError> {
    let probes: Result<Vec<_>, _> = (0..FILES_OF_A_PORT).map(|_| std::fs::File::open("/dev/null")).collect();
    let error = probes.err()?;
    let used_up = matches!(error.raw_os_error(), Some(libc::EMFILE | libc::ENFILE));
    used_up.then(|| WireError::TooManyFiles {
        name: name.to_owned(),
        cause: error.to_string(),
        limit: limit(),
    })
}

/// Files that this process may have open.
fn limit() -> u64 {
    let mut limit = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
    // SAFETY: `limit` is a valid, writable structure.
    unsafe { libc::getrlimit(libc::RLIMIT_NOFILE, &mut limit) };
    limit.rlim_cur
}

fn full(name: &str, folder: &Path, blocks_count: bool) -> Option<WireError> {
    let status = file_system(folder)?;
    let cause = match (status.f_files > 0 && status.f_favail == 0, blocks_count && status.f_bavail == 0) {
        (true, _) => "all inodes are in use",
        (false, true) => "the file system is full",
        (false, false) => return None,
    };
    let (name, folder) = (name.to_owned(), folder.display().to_string());
    Some(WireError::NoFiles { name, folder, cause: cause.to_owned() })
}

/// Free space of the file system of `folder`; `None` on errors.
pub(super) fn file_system(folder: &Path) -> Option<libc::statvfs> {
    let path = std::ffi::CString::new(folder.as_os_str().as_encoded_bytes()).ok()?;
    // SAFETY: all-zero is a valid statvfs; the path is a C string that lives across the call.
    let (code, status) = unsafe {
        let mut status: libc::statvfs = std::mem::zeroed();
        (libc::statvfs(path.as_ptr(), &mut status), status)
    };
    (code == 0).then_some(status)
}
