//! Services of ROS 2: `softtwin/<actuator>/describe` and the queries of each twin. Requests wait in one queue and are answered one after
//! the other by a thread of their own, because a twin may take a second.
//!
//! A service is a queryable on its key, complete because clients ask complete ones only. The request is the query's payload; the reply's
//! attachment has the number and the client of the request's (design document of `rmw_zenoh`, "Service Clients" and "Service Servers").

use super::config::{Ros2, ros_name};
use super::wire_format::{
    Cdr, CdrReader, Entity, FIND_GAP, FIND_PRESSURE, Gid, MessageType, Names, TRIGGER, WHAT_IF,
    attachment_of, now_since_1970_ns, parse_attachment, token,
};
use crate::link::{Counters, Link, count, network};
use crate::queries::Clients;
use crate::topics::refuse;
use recording::message::Json;
use runtime::known_model::KnownInput;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread;
use std::time::{Duration, Instant};
use wire::layout::{InputValue, PARAMETERS_MAX, field_id, flags, hex, pack_name, query_kind, regime};
use wire::{Answer, Bus, Payload, State, StateReader, Topic, TopicInfo, TopicKind, Waking, WireError};
use zenoh::Wait;
use zenoh::liveliness::LivelinessToken;
use zenoh::query::{Query, Queryable};

/// Largest number of waiting requests.
const CALLS: usize = 64;
/// Largest number of parameters in one request, above that of any model.
const MAX_NAMES: usize = 64;
/// Longest wait of a request for a state of its twin.
const PATIENCE: Duration = Duration::from_secs(1);
const TICK: Duration = Duration::from_millis(100);
/// Interval of looks for the first state.
const PACE: Duration = Duration::from_millis(2);
/// First entity number of services, above those of publishers and subscriptions.
const FIRST: usize = 30_000;

/// Both ends of the queue of requests.
pub fn channel() -> (SyncSender<Call>, Receiver<Call>) {
    sync_channel(CALLS)
}

/// Announces the services of new twins. Those of an ended twin stay and answer with the reason.
pub struct Services {
    /// By the actuator's name in ROS.
    by_twin: BTreeMap<String, Vec<Service>>,
    sender: SyncSender<Call>,
}

impl Services {
    pub fn new(sender: SyncSender<Call>) -> Self {
        Self { by_twin: BTreeMap::new(), sender }
    }

    pub fn announce(&mut self, link: &Link, names: &Names, found: &[TopicInfo]) -> anyhow::Result<()> {
        let is_alive = |info: &&TopicInfo| info.topic.kind() == TopicKind::State && !info.writers.is_empty();
        for actuator in found.iter().filter(is_alive).map(|info| info.topic.actuator()) {
            let name = ros_name(actuator);
            if self.by_twin.contains_key(&name) {
                continue;
            }
            let first = FIRST + self.by_twin.len() * ServiceKind::ALL.len();
            let services = (first..).zip(ServiceKind::ALL).map(|(number, kind)| {
                Service::declare(link, names, number, actuator, kind, self.sender.clone())
            });
            self.by_twin.insert(name, services.collect::<anyhow::Result<_>>()?);
        }
        Ok(())
    }
}

/// Answers requests until the gateway ends.
pub fn run(link: &Link, ros: &Ros2, calls: &Receiver<Call>) -> anyhow::Result<()> {
    let bus = Bus::open(&link.domain)?;
    let mut clients = Clients::open(link)?;
    while link.is_running() {
        let Ok(call) = calls.recv_timeout(TICK) else { continue };
        match answer(&bus, &mut clients, ros, &call) {
            Some(message) => call.reply(message),
            None if call.kind == ServiceKind::Describe => {
                call.refuse("expected an empty request in little-endian CDR");
            }
            None => {
                let (name, _) = call.kind.name_and_type();
                call.refuse(&format!(
                    "expected a request to {name} of at most {MAX_NAMES} parameters in little-endian CDR"
                ));
            }
        }
    }
    Ok(())
}

/// The response to a request; `None` if it is malformed.
fn answer(bus: &Bus, clients: &mut Clients, ros: &Ros2, call: &Call) -> Option<Vec<u8>> {
    if call.kind == ServiceKind::Describe {
        CdrReader::new(&call.request)?;
        let state = newest_state(bus, &call.actuator).unwrap_or_else(|error| {
            tracing::debug!("{error}");
            None
        });
        return Some(description(ros, &call.actuator, state.as_ref()));
    }
    let query = match call.kind.query(&call.request)? {
        Ok(query) => query,
        Err(reason) => return Some(refusal(&reason)),
    };
    Some(match clients.ask(&call.actuator, &query) {
        Ok(sample) => response(sample.answer(), sample.values()),
        Err(error) => refusal(&error.to_string()),
    })
}

/// The newest state of a twin. A reader gets the last one with the twin's next step, so it may take a moment.
fn newest_state(bus: &Bus, actuator: &str) -> Result<Option<State>, WireError> {
    let reader = StateReader::attach_as(bus, &Topic::state(actuator)?, Waking::Never)?;
    let end = Instant::now() + PATIENCE;
    loop {
        let state = reader.newest()?;
        if state.is_some() || Instant::now() >= end {
            return Ok(state);
        }
        thread::sleep(PACE);
    }
}

/// Services of each twin. The types of all but the first are defined in clients/ros2/softtwin_interfaces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ServiceKind {
    /// Model, input ranges and newest state, as JSON (`std_srvs/Trigger`).
    Describe,
    /// The state at a pressure and a gap.
    WhatIf,
    /// The pressure of a force.
    Pressure,
    /// The gap of a force.
    Gap,
}

impl ServiceKind {
    const ALL: [Self; 4] = [Self::Describe, Self::WhatIf, Self::Pressure, Self::Gap];

    /// Name of the service after the actuator's, and type.
    fn name_and_type(self) -> (&'static str, MessageType) {
        match self {
            Self::Describe => ("describe", TRIGGER),
            Self::WhatIf => ("what_if", WHAT_IF),
            Self::Pressure => ("find_pressure", FIND_PRESSURE),
            Self::Gap => ("find_gap", FIND_GAP),
        }
    }

    /// The query in a request, or why a well-formed request has none; `None` for a malformed request.
    fn query(self, request: &[u8]) -> Option<Result<wire::Query, String>> {
        let mut reader = CdrReader::new(request)?;
        let mut number = || reader.double();
        let query = match self {
            Self::Describe => return None,
            Self::WhatIf => wire::Query {
                kind: query_kind::WHATIF,
                pressure_mpa: number()?,
                gap_mm: number()?,
                ..wire::Query::default()
            },
            Self::Pressure => wire::Query {
                kind: query_kind::PRESSURE,
                force_n: number()?,
                gap_mm: number()?,
                ..wire::Query::default()
            },
            Self::Gap => wire::Query {
                kind: query_kind::GAP,
                pressure_mpa: number()?,
                force_n: number()?,
                force_halfwidth_n: number()?,
                ..wire::Query::default()
            },
        };
        let names = reader.strings(MAX_NAMES)?;
        let values = reader.doubles(MAX_NAMES)?;
        let node_set = reader.string()?;
        Some(completed(query, &names, &values, node_set))
    }
}

/// The query with parameters and node set.
fn completed(
    mut query: wire::Query,
    names: &[&str],
    values: &[f64],
    node_set: &str,
) -> Result<wire::Query, String> {
    if names.len() != values.len() {
        let (names, values) = (names.len(), values.len());
        return Err(format!("expected as many parameters as parameter_names, found {values} and {names}"));
    }
    for (name, value) in names.iter().zip(values) {
        if !query.set_parameter(name, *value) {
            return Err(format!("expected at most {PARAMETERS_MAX} parameters, found {}", names.len()));
        }
    }
    if !node_set.is_empty() {
        if Topic::field("any", Some(node_set)).is_err() {
            return Err(format!("expected the name of a node set in node_set, found {node_set:?}"));
        }
        (query.want_field, query.node_set) = (1, pack_name(node_set));
    }
    Ok(query)
}

/// The response with an answer of the twin and the field behind it.
fn response(answer: &Answer, field: &[f32]) -> Vec<u8> {
    match answer.refusal() {
        None => answer_message(true, "", answer, field),
        Some(reason) => answer_message(false, &reason, answer, &[]),
    }
}

/// The negative response with its reason.
fn refusal(reason: &str) -> Vec<u8> {
    answer_message(false, reason, &Answer::default(), &[])
}

/// A response: success and message, then `softtwin_interfaces/Answer`.
fn answer_message(is_success: bool, message: &str, answer: &Answer, field: &[f32]) -> Vec<u8> {
    let inputs: Vec<InputValue> = answer.inputs().collect();
    let names: Vec<&str> = inputs.iter().map(|input| input.name.as_str()).collect();
    let with_list = |message: Cdr, value: fn(&InputValue) -> f64| {
        let values: Vec<f64> = inputs.iter().map(value).collect();
        message.word(values.len() as u32).doubles(&values)
    };
    let message = Cdr::new().byte(u8::from(is_success)).string(message);
    let message = message.doubles(&[answer.pressure_mpa, answer.gap_mm]).strings(&names);
    let message = with_list(message, |input| input.value).string(regime::as_str(answer.regime));
    let message = message.byte(answer.domain_status as u8).doubles(&[
        answer.domain_distance.into(),
        answer.contact_force_n,
        answer.force_halfwidth_n.into(),
    ]);
    let message = with_list(message, |input| input.force_by).doubles(&[
        answer.onset_pressure_mpa,
        answer.displacement_halfwidth_mm.into(),
        answer.von_mises_halfwidth_mpa.into(),
        answer.uncertainty,
        answer.low,
        answer.high,
    ]);
    let has_field = !field.is_empty();
    let fields: Vec<&str> = answer.fields().filter(|_| has_field).map(field_id::as_str).collect();
    let nodes = if has_field { answer.node_count } else { 0 };
    let message = message.strings(&fields).word(nodes).word(field.len() as u32).floats(field);
    let set: Vec<&str> = flags::names(answer.flags).collect();
    let message = message.doubles(&[answer.max_von_mises_mpa]).word(answer.max_von_mises_node);
    message.strings(&set).string(&hex(&answer.model_hash)).finish()
}

/// The answer to a request for a description: model, its inputs with their ranges, and the newest state as on the key
/// `softtwin/<actuator>/state`; without a state the reason.
fn description(ros: &Ros2, actuator: &str, state: Option<&State>) -> Vec<u8> {
    let Some(state) = state else {
        let reason = format!("no state of {actuator}; is its twin running, and does it get readings?");
        return trigger_response(false, &reason);
    };
    let input = |input: &KnownInput| json!({ "name": input.key, "unit": input.unit, "range": input.range });
    let known = ros.models.iter().find(|model| model.hash == state.model_hash);
    let model = known.map(|model| {
        json!({ "name": model.name, "inputs": model.inputs.iter().map(input).collect::<Vec<Value>>() })
    });
    // Numbers and strings only: serialisation cannot fail.
    let state = serde_json::to_value(Json::new(state.view())).unwrap_or_default();
    trigger_response(true, &json!({ "actuator": actuator, "model": model, "state": state }).to_string())
}

/// A `std_srvs/Trigger_Response`.
fn trigger_response(is_success: bool, message: &str) -> Vec<u8> {
    Cdr::new().byte(u8::from(is_success)).string(message).finish()
}

// ---- a service in the graph ----

const MAX_BYTES: usize = 64 * 1024;

/// A service in the graph while it exists.
pub struct Service {
    _queryable: Queryable<()>,
    _token: LivelinessToken,
}

/// A request to a service of one twin.
pub struct Call {
    actuator: String,
    kind: ServiceKind,
    request: Vec<u8>,
    number: i64,
    client: Gid,
    query: Query,
    context: Arc<Context>,
}

/// Data shared by all requests to one service.
struct Context {
    key: String,
    counters: Arc<Counters>,
    is_logged: AtomicBool,
}

impl Service {
    /// Announces a service of an actuator's twin, with its entity number within the node; requests go to `sender`.
    fn declare(
        link: &Link,
        names: &Names,
        number: usize,
        actuator: &str,
        kind: ServiceKind,
        sender: SyncSender<Call>,
    ) -> anyhow::Result<Self> {
        let (suffix, message_type) = kind.name_and_type();
        let name = format!("softtwin/{}/{suffix}", ros_name(actuator));
        let context = Arc::new(Context {
            key: names.key(&name, message_type, message_type.hash),
            counters: link.counters.clone(),
            is_logged: AtomicBool::new(false),
        });
        let actuator = actuator.to_owned();
        let take = move |query: Query| match accept(&query, message_type) {
            Ok((request, number, client)) => {
                let (actuator, context) = (actuator.clone(), context.clone());
                let call = Call { actuator, kind, request, number, client, query, context };
                if let Err(TrySendError::Full(call) | TrySendError::Disconnected(call)) =
                    sender.try_send(call)
                {
                    call.refuse("too many requests wait here; ask again later");
                }
            }
            Err(text) => context.refuse(&query, &text),
        };
        // With any hash: a wrong one is reported.
        let queryable = link.session.declare_queryable(names.key(&name, message_type, "*"));
        let queryable = network(queryable.complete(true).callback(take).wait())?;
        let endpoint = names.endpoint(number, Entity::Service, &name, message_type);
        Ok(Self { _queryable: queryable, _token: token(link, endpoint)? })
    }
}

/// Request, number and client of a query.
fn accept(query: &Query, message_type: MessageType) -> Result<(Vec<u8>, i64, Gid), String> {
    let key = query.key_expr().as_str();
    message_type.check_hash(key)?;
    let length = query.payload().map_or(0, |payload| payload.len());
    if length > MAX_BYTES {
        return Err(format!("{key}: expected at most {MAX_BYTES} bytes, found {length}"));
    }
    let beside = query.attachment().and_then(|bytes| parse_attachment(&bytes.to_bytes()));
    let (number, client) = beside
        .ok_or_else(|| format!("{key}: expected an attachment of number, time and client, found none"))?;
    Ok((query.payload().map_or_else(Vec::new, |payload| payload.to_bytes().into_owned()), number, client))
}

impl Context {
    /// Replies with an error, counts it, and logs it once.
    fn refuse(&self, query: &Query, text: &str) {
        if !self.is_logged.swap(true, Ordering::Relaxed) {
            tracing::warn!("a request from ROS is refused (logged once per service): {text}");
        }
        refuse(query, text, &self.counters.refusals);
    }
}

impl Call {
    fn reply(&self, message: Vec<u8>) {
        let beside = attachment_of(self.number, now_since_1970_ns(), self.client);
        match self.query.reply(self.context.key.as_str(), message).attachment(beside).wait() {
            Ok(()) => count(&self.context.counters.answers),
            Err(error) => tracing::debug!("{}: the client has ended: {error}", self.context.key),
        }
    }

    fn refuse(&self, text: &str) {
        self.context.refuse(&self.query, &format!("{}: {text}", self.context.key));
    }
}

#[cfg(test)]
#[path = "../../tests/unit/services.rs"]
mod tests;
