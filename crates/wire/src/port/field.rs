//! Ports of field topics: the field is written straight into the memory that the readers map.

use super::segment;
use super::service::{self, Missing};
use super::writer_lock::WriterLock;
use crate::bus::Bus;
use crate::clock::now_ns;
use crate::error::WireError;
use crate::layout::{self, FieldHeader};
use crate::qos;
use crate::topic::Topic;
use crate::transport::Ipc;
use crate::wake::{Wakeable, Waker, Waking};
use iceoryx2::port::{notifier::Notifier, publisher::Publisher, subscriber::Subscriber};
use iceoryx2::prelude::{AllocationStrategy, BackpressureStrategy};
use iceoryx2::sample::Sample;
use iceoryx2::sample_mut::SampleMut;
use std::rc::Rc;

/// The one writer of a field topic.
#[derive(Debug)]
pub struct FieldWriter {
    bus: Bus,
    port: Rc<Port>,
}

/// What a writer shares with its loans, so that a loan is sent where it came from.
#[derive(Debug)]
struct Port {
    topic: Topic,
    entries: usize,
    publisher: Publisher<Ipc, [f32], FieldHeader>,
    notifier: Notifier<Ipc>,
    // Last: given back after the ports are.
    _lock: WriterLock,
}

/// A sample on loan: memory that all readers will map once it is sent. Dropping it unsent gives it back.
#[derive(Debug)]
pub struct FieldLoan {
    sample: SampleMut<Ipc, [f32], FieldHeader>,
    port: Rc<Port>,
}

/// One of many readers of a field topic.
#[derive(Debug)]
pub struct FieldReader {
    topic: Topic,
    subscriber: Subscriber<Ipc, [f32], FieldHeader>,
    waker: Waker,
}

/// A received field. Nothing was copied; the memory stays as it is until this is dropped. A reader may hold at most
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
    /// [`WireError::AlreadyPublished`] when a living process writes already, [`WireError::NoMemory`] when /dev/shm is
    /// full, [`WireError::Incompatible`] when a program of another version made the topic.
    pub fn create(bus: &Bus, topic: &Topic, entries: usize) -> Result<Self, WireError> {
        let lock = service::retry(bus, topic.name(), || WriterLock::take(&bus.places, topic.name(), ""))?;
        let qos = qos::of(topic.kind());
        let service = service::slices(bus, topic, Missing::Create)?;
        let publisher = service::retry(bus, topic.name(), || {
            service
                .publisher_builder()
                .initial_max_slice_len(entries)
                .allocation_strategy(AllocationStrategy::Static)
                .max_loaned_samples(qos.max_loans)
                .backpressure_strategy(BackpressureStrategy::DiscardData)
                .override_sample_preallocation(move |worst| worst.min(qos.samples_in_use()))
                .create()
                .map_err(|error| service::writer_failed(bus, topic, error))
        })?;
        segment::reserve(&bus.places, topic, publisher.id().value())?;
        let notifier = service::notifier(bus, topic)?;
        let port = Port { topic: topic.clone(), entries, publisher, notifier, _lock: lock };
        Ok(Self { bus: bus.clone(), port: Rc::new(port) })
    }

    /// Takes a free sample of the full length. Its values are whatever an earlier field left there: write all of them.
    ///
    /// # Errors
    /// [`WireError::Loan`] when no sample is free.
    pub fn loan(&self) -> Result<FieldLoan, WireError> {
        let port = &self.port;
        let sample = port.publisher.loan_slice_uninit(port.entries).map_err(|error| WireError::Loan {
            topic: port.topic.name().into(),
            cause: format!("{error:?}"),
        })?;
        // SAFETY: the memory is a shared mapping that the kernel handed out zeroed and that only `f32` are written to;
        // every bit pattern is a valid `f32`, so the values are initialised whatever was there before.
        let sample = unsafe { sample.assume_init() };
        Ok(FieldLoan { sample, port: port.clone() })
    }

    /// Maps all pages into this process ahead of use; returns the bytes.
    ///
    /// # Errors
    /// The system's refusal to show the mapping.
    pub fn prefault(&self) -> std::io::Result<u64> {
        segment::prefault(&self.bus.places, self.port.publisher.id().value())
    }

    /// The topic.
    pub fn topic(&self) -> &Topic {
        &self.port.topic
    }

    /// Values of a sample.
    pub fn entries(&self) -> usize {
        self.port.entries
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
        let Port { topic, entries, notifier, .. } = &*self.port;
        check_shape(topic, &header, *entries)?;
        let t_publish_ns = now_ns();
        *self.sample.user_header_mut() = FieldHeader { t_publish_ns, ..header };
        let failed = |cause: String| WireError::Send { topic: topic.name().to_owned(), cause };
        self.sample.send().map_err(|error| failed(format!("{error:?}")))?;
        notifier.notify().map_err(|error| failed(format!("{error:?}")))?;
        Ok(t_publish_ns)
    }
}

impl FieldReader {
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
        let service = service::slices(bus, topic, missing)?;
        let (subscriber, waker) = service::reader(bus, topic, &service, waking)?;
        Ok(Self { topic: topic.clone(), subscriber, waker })
    }

    /// The oldest waiting field, if there is one. Never blocks, copies nothing.
    ///
    /// # Errors
    /// [`WireError::Receive`] when a connection broke or too many samples are held, [`WireError::FieldShape`] when header
    /// and payload contradict each other.
    pub fn next(&self) -> Result<Option<FieldSample>, WireError> {
        let received = self.subscriber.receive().map_err(|error| WireError::Receive {
            topic: self.topic.name().into(),
            cause: format!("{error:?}"),
        })?;
        let Some(sample) = received else { return Ok(None) };
        check_shape(&self.topic, sample.user_header(), sample.payload().len())?;
        Ok(Some(FieldSample { sample }))
    }

    /// The newest waiting field; older ones are given back. Never blocks.
    ///
    /// # Errors
    /// As [`Self::next`].
    pub fn newest(&self) -> Result<Option<FieldSample>, WireError> {
        let waiting = || {
            self.subscriber.has_samples().map_err(|error| WireError::Receive {
                topic: self.topic.name().into(),
                cause: format!("{error:?}"),
            })
        };
        // A sample is given back before the next is taken: a reader that already holds all but one of the samples it
        // may hold can still get at the newest.
        loop {
            let Some(sample) = self.next()? else { return Ok(None) };
            if !waiting()? {
                return Ok(Some(sample));
            }
        }
    }

    /// Whether a field waits; not where that cannot be told: [`Self::next`] says why. Never blocks, takes nothing.
    pub fn has_next(&self) -> bool {
        self.subscriber.has_samples().unwrap_or(false)
    }

    /// The topic.
    pub fn topic(&self) -> &Topic {
        &self.topic
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

    /// One field (a number of [`layout::field_id`]), one value a node; `None` when it is not in this sample.
    pub fn field(&self, id: u8) -> Option<&[f32]> {
        self.header().column(self.values(), id)
    }
}

impl Wakeable for FieldReader {
    fn waker(&self) -> Waker {
        self.waker.clone()
    }
}

/// Both sides check: the writer before sending, the reader after receiving.
fn check_shape(topic: &Topic, header: &FieldHeader, found: usize) -> Result<(), WireError> {
    let fits = header.entries() == found as u64
        && header.layout_version == layout::VERSION
        && header.field_count as usize <= layout::FIELD_SLOTS;
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
