//! Questions from the network, put to the twins of this machine one after the other.

use crate::fields::values;
use crate::lane::{Parcel, encoding, refuse, reply};
use crate::link::{Link, network};
use recording::message::AnswerMessage;
use serde_json::json;
use std::collections::HashMap;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::Duration;
use wire::layout::{field_id, query_kind, unpack_name};
use wire::{AnswerSample, Bus, QueryClient, Selector};
use zenoh::Wait;
use zenoh::bytes::ZBytes;
use zenoh::query::{Query, Queryable};

/// Questions that may wait.
const QUESTIONS: usize = 64;
/// Longest wait for a twin.
const PATIENCE: Duration = Duration::from_secs(1);
/// Longest sleep.
const TICK: Duration = Duration::from_millis(100);

/// A question and the local name it was put to.
type Asked = (String, Query);

/// The way to the thread that asks.
#[derive(Clone)]
pub struct Desk {
    sender: SyncSender<Asked>,
}

/// A desk, and what comes over it.
pub fn desk() -> (Desk, Receiver<Asked>) {
    let (sender, receiver) = sync_channel(QUESTIONS);
    (Desk { sender }, receiver)
}

impl Desk {
    /// Takes all kinds of questions for one actuator, as long as the result lives.
    ///
    /// # Errors
    /// When the session is closed.
    pub fn open(&self, link: &Link, actuator: &str) -> anyhow::Result<Vec<Queryable<()>>> {
        let declare = |(_, kind): &(u32, &str)| {
            let name = format!("softtwin/{actuator}/{kind}");
            let (sender, counters, key) = (self.sender.clone(), link.counters.clone(), link.key(&name));
            let queryable = link.session.declare_queryable(key).callback(move |query| {
                if let Err(TrySendError::Full((_, query)) | TrySendError::Disconnected((_, query))) =
                    sender.try_send((name.clone(), query))
                {
                    refuse(&query, "too many questions wait; ask again later", &counters.refusals);
                }
            });
            network(queryable.wait())
        };
        query_kind::NAMES.iter().map(declare).collect()
    }
}

/// Answers until the gateway ends.
///
/// # Errors
/// When the domain cannot be joined.
pub fn run(link: &Link, questions: &Receiver<Asked>) -> anyhow::Result<()> {
    let bus = Bus::open(&link.domain)?;
    let mut clients = HashMap::new();
    while link.goes_on() {
        match questions.recv_timeout(TICK) {
            Ok((name, query)) => match ask(&bus, &mut clients, &name, &query) {
                Ok(sample) => {
                    let is_field = sample.answer().entries() > 0;
                    reply(link, &query, &link.key(&name), &parcel(&sample), encoding(is_field));
                }
                Err(error) => refuse(&query, &format!("{error:#}"), &link.counters.refusals),
            },
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    Ok(())
}

fn ask(
    bus: &Bus,
    clients: &mut HashMap<String, QueryClient>,
    name: &str,
    query: &Query,
) -> anyhow::Result<AnswerSample> {
    let selector = Selector::parse(&format!("{name}?{}", query.parameters().as_str()))?;
    let actuator = selector.actuator().unwrap_or_default().to_owned();
    let question = selector.questions(&actuator).into_iter().next();
    let question = question.ok_or_else(|| anyhow::anyhow!("`{name}` asks nothing"))?;
    let mut client = match clients.remove(&actuator) {
        Some(client) => client,
        None => QueryClient::open(bus, &actuator)?,
    };
    // A client whose twin has gone is not kept: the next question finds the next twin.
    let sample = client.ask(&question, PATIENCE)?;
    clients.insert(actuator, client);
    Ok(sample)
}

/// JSON; with a field its values, and the JSON beside them.
fn parcel(sample: &AnswerSample) -> Parcel {
    let answer = sample.answer();
    let mut message = json!(AnswerMessage::from(answer));
    if answer.entries() == 0 {
        return Parcel { payload: ZBytes::from(message.to_string()), attachment: None };
    }
    message["node_set"] = json!(unpack_name(&answer.node_set));
    message["node_count"] = json!(answer.node_count);
    message["fields"] = answer.fields().map(field_id::as_str).collect();
    message["max_von_mises_mpa"] = json!(answer.max_von_mises_mpa);
    message["max_von_mises_node"] = json!(answer.max_von_mises_node);
    Parcel { payload: values(sample.values()), attachment: Some(ZBytes::from(message.to_string())) }
}
