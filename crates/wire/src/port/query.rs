//! Questions and answers: one server a twin, many clients. Nothing here is on the real-time path.

use super::memory::require_room;
use super::retry::Refusal;
use super::service::{self, EventShape, Missing};
use crate::bus::Bus;
use crate::error::WireError;
use crate::layout::{Answer, Query};
use crate::qos;
use crate::sys::Ipc;
use crate::topic::{ROOT, check_name};
use crate::wake::{Wake, WakeSet, Wakeable, Waker};
use iceoryx2::active_request::ActiveRequest;
use iceoryx2::pending_response::PendingResponse;
use iceoryx2::port::client::Client;
use iceoryx2::port::listener::ListenerCreateError;
use iceoryx2::port::notifier::{Notifier, NotifierCreateError};
use iceoryx2::port::server::Server;
use iceoryx2::prelude::*;
use iceoryx2::response::Response;
use iceoryx2::service::builder::request_response::{
    RequestResponseOpenError as OpenError, RequestResponseOpenOrCreateError as OpenOrCreateError,
};
use iceoryx2::service::port_factory::client::ClientCreateError;
use iceoryx2::service::port_factory::request_response::PortFactory;
use std::os::fd::OwnedFd;
use std::time::{Duration, Instant};

type Service = PortFactory<Ipc, Query, (), [f32], Answer>;
type Pending = PendingResponse<Ipc, Query, (), [f32], Answer>;

/// Query server of an actuator, used by the twin's query thread.
///
/// Answers without a field take no memory beyond the first page. Memory for fields is reserved at the first query for one.
#[derive(Debug)]
pub struct QueryServer {
    name: String,
    server: Server<Ipc, Query, (), [f32], Answer>,
    waker: Waker,
    answered: Notifier<Ipc>,
}

/// One that asks.
#[derive(Debug)]
pub struct QueryClient {
    name: String,
    client: Client<Ipc, Query, (), [f32], Answer>,
    asking: Notifier<Ipc>,
    answered: WakeSet,
}

/// Longest wait before a client looks whether its question is still held by the twin.
const LOOK_AGAIN: Duration = Duration::from_millis(100);

/// A question that waits for its answer from the server that took it.
#[derive(Debug)]
pub struct Question<'a> {
    server: &'a QueryServer,
    request: ActiveRequest<Ipc, Query, (), [f32], Answer>,
}

/// A question that was sent.
#[derive(Debug)]
pub struct Asked {
    query: Query,
    pending: Pending,
}

/// Received answer. Nothing was copied; the memory is unchanged until this is dropped.
#[derive(Debug)]
pub struct AnswerSample {
    response: Response<Ipc, [f32], Answer>,
}

/// Names of the services of one actuator: questions (with the event that wakes the twin) and the event that wakes clients.
struct Names {
    query: String,
    answer: String,
}

impl Names {
    fn of(actuator: &str) -> Result<Self, WireError> {
        check_name("actuator", actuator)?;
        Ok(Self { query: format!("{ROOT}/{actuator}/query"), answer: format!("{ROOT}/{actuator}/answer") })
    }
}

const ASKED: EventShape =
    EventShape { listeners: 1, notifiers: qos::MAX_CLIENTS, nodes: qos::MAX_QUERY_NODES };
const ANSWERED: EventShape =
    EventShape { listeners: qos::MAX_CLIENTS, notifiers: 1, nodes: qos::MAX_QUERY_NODES };

impl QueryServer {
    /// Becomes the one that answers for `actuator`.
    ///
    /// # Errors
    /// [`WireError::AlreadyPublished`] when another twin answers, [`WireError::Incompatible`] when a program of another
    /// version made the service.
    pub fn create(bus: &Bus, actuator: &str) -> Result<Self, WireError> {
        let names = Names::of(actuator)?;
        let name = names.query.as_str();
        let service = open(bus, name, Missing::Create)?;
        let waker = waker(bus, &service::named_events(bus, name, ASKED)?, name)?;
        let answered = notifier(bus, &service::named_events(bus, &names.answer, ANSWERED)?, &names.answer)?;
        let server = service::retry(bus, name, || {
            service
                .server_builder()
                .initial_max_slice_len(1)
                .allocation_strategy(AllocationStrategy::BestFit)
                .max_loaned_responses_per_request(1)
                .backpressure_strategy(BackpressureStrategy::DiscardData)
                .create()
                .map_err(|error| {
                    let holder = format!(" ({error:?})");
                    Refusal::Full(WireError::AlreadyPublished { topic: name.to_owned(), holder })
                })
        })?;
        Ok(Self { name: names.query, server, waker, answered })
    }

    /// Oldest waiting query. Never blocks; queries of closed clients are skipped.
    ///
    /// # Errors
    /// [`WireError::Receive`] when a connection broke.
    pub fn next(&self) -> Result<Option<Question<'_>>, WireError> {
        let received = self.server.receive();
        let request = received
            .map_err(|error| WireError::Receive { topic: self.name.clone(), cause: format!("{error:?}") })?;
        Ok(request.map(|request| Question { server: self, request }))
    }
}

impl Wakeable for QueryServer {
    fn waker(&self) -> Waker {
        self.waker.clone()
    }
}

impl Question<'_> {
    /// The query.
    pub fn query(&self) -> &Query {
        self.request.payload()
    }

    /// Answers; `fill` writes the field into the memory that the asker maps and may still change the answer. An answer
    /// without a field (`entries` 0) goes out at once.
    ///
    /// # Errors
    /// [`WireError::NoMemory`] when the field does not fit into /dev/shm (answer then without it),
    /// [`WireError::Send`] when the port broke.
    pub fn answer(
        &self,
        entries: usize,
        fill: impl FnOnce(&mut [f32], &mut Answer),
    ) -> Result<(), WireError> {
        let needed_bytes = entries as u64 * size_of::<f32>() as u64;
        let server = self.server;
        require_room(&server.name, needed_bytes)?;
        let loan = self
            .request
            .loan_slice_uninit(entries)
            .map_err(|error| WireError::Loan { topic: server.name.clone(), cause: format!("{error:?}") })?;
        // SAFETY: the memory is a shared mapping that the kernel handed out zeroed and that only `f32` are written to;
        // every bit pattern is a valid `f32`.
        let mut response = unsafe { loan.assume_init() };
        let mut answer = Answer::default();
        fill(response.payload_mut(), &mut answer);
        *response.user_header_mut() = answer;
        let failed = |cause: String| WireError::Send { topic: server.name.clone(), cause };
        response.send().map_err(|error| failed(format!("{error:?}")))?;
        server.answered.notify().map_err(|error| failed(format!("{error:?}")))?;
        Ok(())
    }
}

impl QueryClient {
    /// Opens the way to the twin of `actuator`.
    ///
    /// # Errors
    /// [`WireError::NobodyAnswers`] when no twin serves it, [`WireError::Incompatible`] when one of another version does.
    pub fn open(bus: &Bus, actuator: &str) -> Result<Self, WireError> {
        let names = Names::of(actuator)?;
        let name = names.query.as_str();
        let service = open(bus, name, Missing::Refuse)?;
        // A dead server's service remains until the next clean-up.
        let asking = notifier(bus, &service::named_events(bus, name, ASKED)?, name)?;
        let answered = waker(bus, &service::named_events(bus, &names.answer, ANSWERED)?, &names.answer)?;
        let client = service::retry(bus, name, || {
            service
                .client_builder()
                .backpressure_strategy(BackpressureStrategy::DiscardData)
                .create()
                .map_err(|error| match error {
                    ClientCreateError::ExceedsMaxSupportedClients => Refusal::Full(too_many_clients(name)),
                    other => Refusal::Final(WireError::Open {
                        topic: name.to_owned(),
                        cause: format!("{other:?}"),
                    }),
                })
        })?;
        Ok(Self { name: names.query, client, asking, answered: WakeSet::of([answered]) })
    }

    /// Asks and waits for the answer.
    ///
    /// # Errors
    /// [`WireError::NobodyAnswers`] when the twin has gone, [`WireError::NoAnswer`] when `timeout` is over,
    /// [`WireError::Receive`] and [`WireError::Send`] when the ports broke. A refusal of the twin is an answer, see
    /// [`Answer::refusal`].
    pub fn ask(&mut self, query: &Query, timeout: Duration) -> Result<AnswerSample, WireError> {
        let end = Instant::now() + timeout;
        let mut asked = self.send(query)?;
        loop {
            if let Some(answer) = self.answer(&mut asked)? {
                return Ok(answer);
            }
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Err(self.silent(timeout));
            }
            // Every answer to anybody wakes all who wait: look, do not assume.
            self.wait(left.min(LOOK_AGAIN))?;
        }
    }

    /// Sends a question, for a program that waits in its own way.
    ///
    /// # Errors
    /// [`WireError::NobodyAnswers`] when the twin has gone, [`WireError::Send`] when the ports broke.
    pub fn send(&self, query: &Query) -> Result<Asked, WireError> {
        Ok(Asked { query: *query, pending: self.pending(query)? })
    }

    /// The answer, if it has come. Never blocks.
    ///
    /// # Errors
    /// As [`Self::ask`], without the time.
    pub fn answer(&self, asked: &mut Asked) -> Result<Option<AnswerSample>, WireError> {
        let is_held = asked.pending.is_connected();
        if let Some(response) = self.receive(&asked.pending)? {
            return Ok(Some(AnswerSample { response }));
        }
        if !is_held {
            // The twin let go of the question and no answer came: one that was sent while the connection was being made is
            // lost. Asked again, or refused when the twin has gone.
            asked.pending = self.pending(&asked.query)?;
        }
        Ok(None)
    }

    /// Sleeps until a twin has answered somebody, `limit` is over, or a signal comes.
    ///
    /// # Errors
    /// As [`WakeSet::wait`].
    pub fn wait(&mut self, limit: Duration) -> Result<Wake, WireError> {
        self.answered.wait(limit)
    }

    /// As [`WakeSet::descriptor`].
    ///
    /// # Errors
    /// As [`WakeSet::descriptor`].
    pub fn descriptor(&self) -> Result<OwnedFd, WireError> {
        self.answered.descriptor()
    }

    /// The error of a question that was not answered in time.
    pub fn silent(&self, timeout: Duration) -> WireError {
        let timeout_ms = u64::try_from(timeout.as_millis()).unwrap_or(u64::MAX);
        WireError::NoAnswer { name: self.name.clone(), timeout_ms }
    }

    /// The answer, if it has come.
    fn receive(&self, pending: &Pending) -> Result<Option<Response<Ipc, [f32], Answer>>, WireError> {
        let received = pending.receive();
        received.map_err(|error| WireError::Receive { topic: self.name.clone(), cause: format!("{error:?}") })
    }

    fn pending(&self, query: &Query) -> Result<Pending, WireError> {
        let failed = |cause: String| WireError::Send { topic: self.name.clone(), cause };
        let pending = self.client.send_copy(*query).map_err(|error| failed(format!("{error:?}")))?;
        if pending.number_of_server_connections() == 0 {
            return Err(WireError::NobodyAnswers { name: self.name.clone() });
        }
        self.asking.notify().map_err(|error| failed(format!("{error:?}")))?;
        Ok(pending)
    }
}

impl AnswerSample {
    /// The answer.
    pub fn answer(&self) -> &Answer {
        self.response.user_header()
    }

    /// The field, field-major; empty when none was wanted.
    pub fn values(&self) -> &[f32] {
        self.response.payload().get(..self.answer().entries() as usize).unwrap_or(&[])
    }
}

fn open(bus: &Bus, name: &str, missing: Missing) -> Result<Service, WireError> {
    let service = service::service_name(name)?;
    service::retry(bus, name, || {
        let builder = bus
            .node()
            .service_builder(&service)
            .request_response::<Query, [f32]>()
            .response_user_header::<Answer>()
            .max_servers(1)
            .max_clients(qos::MAX_CLIENTS)
            .max_nodes(qos::MAX_QUERY_NODES)
            .max_active_requests_per_client(qos::MAX_OPEN_QUESTIONS)
            .max_loaned_requests(qos::MAX_OPEN_QUESTIONS)
            .max_response_buffer_size(1)
            .max_borrowed_responses_per_pending_response(1)
            .enable_safe_overflow_for_requests(true)
            .enable_safe_overflow_for_responses(true)
            .enable_fire_and_forget_requests(false);
        match missing {
            Missing::Create => builder.open_or_create().map_err(|error| match error {
                OpenOrCreateError::RequestResponseOpenError(error) => open_failed(name, error),
                other => Refusal::Passing(format!("{other:?}")),
            }),
            Missing::Refuse => builder.open().map_err(|error| open_failed(name, error)),
        }
    })
}

fn too_many_clients(name: &str) -> WireError {
    WireError::TooManyClients { name: name.to_owned(), limit: qos::MAX_CLIENTS }
}

fn open_failed(name: &str, error: OpenError) -> Refusal {
    let cause = format!("{error:?}");
    match error {
        OpenError::DoesNotExist => Refusal::Final(WireError::NobodyAnswers { name: name.to_owned() }),
        OpenError::IsMarkedForDestruction
        | OpenError::ServiceInCorruptedState
        | OpenError::HangsInCreation
        | OpenError::Interrupt
        | OpenError::InternalFailure
        | OpenError::UnableToCreateServiceTag => Refusal::Passing(cause),
        OpenError::InsufficientPermissions => {
            Refusal::Final(WireError::Open { topic: name.to_owned(), cause })
        }
        OpenError::ExceedsMaxNumberOfNodes => {
            Refusal::Full(WireError::TooManyPrograms { name: name.to_owned(), limit: qos::MAX_QUERY_NODES })
        }
        _ => Refusal::Final(WireError::Incompatible { topic: name.to_owned(), cause }),
    }
}

fn waker(bus: &Bus, events: &service::Events, name: &str) -> Result<Waker, WireError> {
    let listener = service::retry(bus, name, || {
        service::bind(events).map_err(|error| match error {
            ListenerCreateError::ExceedsMaxSupportedListeners => Refusal::Full(too_many_clients(name)),
            other => Refusal::Passing(format!("{other:?}")),
        })
    })?;
    Ok(Waker::new(Some(listener)))
}

fn notifier(bus: &Bus, events: &service::Events, name: &str) -> Result<Notifier<Ipc>, WireError> {
    service::retry(bus, name, || {
        events.notifier_builder().create().map_err(|error| match error {
            NotifierCreateError::ExceedsMaxSupportedNotifiers => Refusal::Full(too_many_clients(name)),
            other => Refusal::Passing(format!("{other:?}")),
        })
    })
}
