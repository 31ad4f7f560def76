//! Answers what nodes of ROS ask of this one, in a thread of its own.

use super::config::Ros2;
use super::describe;
use super::names::{Names, QOS, QOS_PARAMETERS};
use super::parameter_services::Access;
use super::parameters;
use super::question::Question;
use super::questions::Asking;
use super::service::{Announced, Call, Service};
use super::twins::Twins;
use super::types::TRIGGER;
use crate::link::Link;
use std::collections::BTreeMap;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::time::{Duration, Instant};
use wire::KeyExpr;

/// Requests that may wait.
const CALLS: usize = 64;
/// Longest wait for the first state of a twin.
const PATIENCE: Duration = Duration::from_secs(2);
/// Longest sleep while nobody asks.
const TICK: Duration = Duration::from_millis(50);
/// Longest sleep while a request waits for states.
const PACE: Duration = Duration::from_millis(2);
/// Numbers of services begin here, behind those of publishers and subscriptions.
const FIRST: usize = 20_000;

/// What a request is about.
#[derive(Clone)]
enum Asked {
    /// The node's parameters.
    Parameters(Access),
    /// One actuator.
    Actuator(String),
}

/// Answers until the gateway ends; requests that a twin answers go to `questions`.
///
/// # Errors
/// When the domain cannot be joined or the session is closed.
pub fn run(
    link: &Link,
    ros: &Ros2,
    keys: &[KeyExpr],
    questions: &SyncSender<Call<Asking>>,
) -> anyhow::Result<()> {
    let mut twins = Twins::open(link, keys)?;
    let (sender, calls) = sync_channel(CALLS);
    let names = Names::new(ros, link);
    let _parameters = announce_parameters(link, ros, &names, &sender)?;
    let mut actuators = BTreeMap::new();
    let mut waiting: Vec<(Call<Asked>, Instant)> = Vec::new();
    while link.goes_on() {
        twins.scan(Instant::now())?;
        announce_actuators(link, &names, &twins, &mut actuators, (&sender, questions))?;
        let arrived = calls.recv_timeout(if waiting.is_empty() { TICK } else { PACE });
        let now = Instant::now();
        for call in arrived.into_iter().chain(calls.try_iter().take(CALLS.saturating_sub(waiting.len()))) {
            if call.what.needs_states() {
                twins.want(now);
            }
            waiting.push((call, now + PATIENCE));
        }
        twins.pump(now);
        let is_due = |(call, until): &mut (Call<Asked>, Instant)| call.what.is_ready(&twins) || now >= *until;
        let due: Vec<_> = waiting.extract_if(.., is_due).collect();
        for (call, _) in due {
            match call.what.answer(&call.request, ros, &mut twins) {
                Ok(message) => call.reply(message),
                Err(text) => call.refuse(&text),
            }
        }
    }
    Ok(())
}

impl Asked {
    fn needs_states(&self) -> bool {
        match self {
            Self::Parameters(access) => access.needs_values(),
            Self::Actuator(_) => true,
        }
    }

    fn is_ready(&self, twins: &Twins) -> bool {
        match self {
            Self::Parameters(access) => !access.needs_values() || twins.are_all_here(),
            Self::Actuator(name) => {
                twins.state(name).is_some() || !twins.names().any(|living| living == name)
            }
        }
    }

    fn answer(&self, request: &[u8], ros: &Ros2, twins: &Twins) -> Result<Vec<u8>, String> {
        match self {
            Self::Parameters(access) => access.answer(request, &parameters::all(ros, twins)),
            Self::Actuator(name) => describe::answer(request, ros, name, twins.state(name))
                .ok_or_else(|| "expected an empty request in little-endian CDR".into()),
        }
    }
}

/// The services through which others see the node's parameters.
fn announce_parameters(
    link: &Link,
    ros: &Ros2,
    names: &Names,
    sender: &SyncSender<Call<Asked>>,
) -> anyhow::Result<Vec<Service>> {
    let declare = |(at, access): (usize, Access)| {
        let (name, of) = access.service();
        let name = format!("{}/{name}", ros.node);
        let announced = Announced { number: FIRST + at, name: &name, of, qos: QOS_PARAMETERS };
        Service::declare(link, names, &announced, Asked::Parameters(access), sender.clone())
    };
    Access::ALL.into_iter().enumerate().map(declare).collect()
}

/// The services of the twins that are new: `softtwin/<actuator>/describe` and the questions. One that has gone is still answered for,
/// with the reason.
fn announce_actuators(
    link: &Link,
    names: &Names,
    twins: &Twins,
    known: &mut BTreeMap<String, Vec<Service>>,
    (sender, questions): (&SyncSender<Call<Asked>>, &SyncSender<Call<Asking>>),
) -> anyhow::Result<()> {
    for name in twins.names() {
        if known.contains_key(name) {
            continue;
        }
        let first = FIRST + Access::ALL.len() + known.len() * (1 + Question::ALL.len());
        let service = format!("softtwin/{name}/describe");
        let announced = Announced { number: first, name: &service, of: TRIGGER, qos: QOS };
        let asked = Asked::Actuator(name.to_owned());
        let mut services = vec![Service::declare(link, names, &announced, asked, sender.clone())?];
        let actuator = twins.actuator(name).unwrap_or(name);
        for (number, question) in (first + 1..).zip(Question::ALL) {
            let (kind, of) = question.service();
            let service = format!("softtwin/{name}/{kind}");
            let announced = Announced { number, name: &service, of, qos: QOS };
            let asking = Asking { actuator: actuator.to_owned(), question };
            services.push(Service::declare(link, names, &announced, asking, questions.clone())?);
        }
        known.insert(name.to_owned(), services);
    }
    Ok(())
}
