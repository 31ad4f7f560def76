//! Queries from the network, passed to the twins one after the other.

use crate::link::Link;
use crate::topics::{EncodedSample, Request, little_endian, refuse, reply};
use recording::message;
use serde_json::json;
use std::collections::HashMap;
use std::sync::mpsc::Receiver;
use std::time::Duration;
use wire::layout::{field_id, unpack_name};
use wire::{AnswerSample, Bus, QueryClient, Selector, WireError};
use zenoh::bytes::ZBytes;
use zenoh::query::Query;

/// Longest wait for a twin.
const PATIENCE: Duration = Duration::from_secs(1);
const TICK: Duration = Duration::from_millis(100);

/// Answers until the gateway ends.
pub fn run(link: &Link, requests: &Receiver<Request>) -> anyhow::Result<()> {
    let mut clients = Clients::open(link)?;
    while link.is_running() {
        let Ok((name, query)) = requests.recv_timeout(TICK) else { continue };
        match ask(&mut clients, &name, &query) {
            Ok(sample) => {
                let encoded = encode(&sample);
                reply(link, &query, &name, &encoded, sample.answer().entries() > 0);
            }
            Err(error) => refuse(&query, &format!("{error:#}"), &link.counters.refusals),
        }
    }
    Ok(())
}

/// Asks the twins of this machine, each through one client.
pub struct Clients {
    bus: Bus,
    by_actuator: HashMap<String, QueryClient>,
}

impl Clients {
    pub fn open(link: &Link) -> Result<Self, WireError> {
        Ok(Self { bus: Bus::open(&link.domain)?, by_actuator: HashMap::new() })
    }

    /// The answer of an actuator's twin.
    ///
    /// # Errors
    /// When there is no such twin, or it does not answer within a second.
    pub fn ask(&mut self, actuator: &str, question: &wire::Query) -> Result<AnswerSample, WireError> {
        let mut client = match self.by_actuator.remove(actuator) {
            Some(client) => client,
            None => QueryClient::open(&self.bus, actuator)?,
        };
        // A client whose twin has ended is dropped: the next query connects to the next twin.
        let sample = client.ask(question, PATIENCE)?;
        self.by_actuator.insert(actuator.to_owned(), client);
        Ok(sample)
    }
}

fn ask(clients: &mut Clients, name: &str, query: &Query) -> anyhow::Result<AnswerSample> {
    let selector = Selector::parse(&format!("{name}?{}", query.parameters().as_str()))?;
    let actuator = selector.actuator().unwrap_or_default().to_owned();
    let question = selector.questions(&actuator).into_iter().next();
    let question = question.ok_or_else(|| anyhow::anyhow!("`{name}` has no query"))?;
    Ok(clients.ask(&actuator, &question)?)
}

/// JSON; for a field its values, with the JSON as attachment.
fn encode(sample: &AnswerSample) -> EncodedSample {
    let answer = sample.answer();
    let mut message = message::answer(answer);
    if answer.entries() == 0 {
        return EncodedSample { payload: ZBytes::from(message.to_string()), attachment: None };
    }
    message["node_set"] = json!(unpack_name(&answer.node_set));
    message["node_count"] = json!(answer.node_count);
    message["fields"] = answer.fields().map(field_id::as_str).collect();
    message["max_von_mises_mpa"] = json!(answer.max_von_mises_mpa);
    message["max_von_mises_node"] = json!(answer.max_von_mises_node);
    EncodedSample {
        payload: little_endian(sample.values()),
        attachment: Some(ZBytes::from(message.to_string())),
    }
}
