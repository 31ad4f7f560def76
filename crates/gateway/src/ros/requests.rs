//! Answers `softtwin/<actuator>/describe`, on a separate thread, and announces the services of each twin.

use super::config::Ros2;
use super::describe;
use super::names::Names;
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

/// Largest number of waiting requests.
const CALLS: usize = 64;
/// Longest wait for the first state of a twin.
const PATIENCE: Duration = Duration::from_secs(2);
/// Longest sleep without requests.
const TICK: Duration = Duration::from_millis(50);
/// Longest sleep while a request waits for a state.
const PACE: Duration = Duration::from_millis(2);
/// First entity number of services, above those of publishers and subscriptions.
const FIRST: usize = 20_000;

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
    let mut services = BTreeMap::new();
    let mut waiting: Vec<(Call<String>, Instant)> = Vec::new();
    while link.goes_on() {
        twins.scan(Instant::now())?;
        announce(link, &names, &twins, &mut services, (&sender, questions))?;
        let arrived = calls.recv_timeout(if waiting.is_empty() { TICK } else { PACE });
        let now = Instant::now();
        for call in arrived.into_iter().chain(calls.try_iter().take(CALLS.saturating_sub(waiting.len()))) {
            twins.want(now);
            waiting.push((call, now + PATIENCE));
        }
        twins.pump(now);
        let is_due = |(call, until): &mut (Call<String>, Instant)| {
            let name = &call.what;
            now >= *until || twins.state(name).is_some() || !twins.names().any(|living| living == name)
        };
        let due: Vec<_> = waiting.extract_if(.., is_due).collect();
        for (call, _) in due {
            match describe::answer(&call.request, ros, &call.what, twins.state(&call.what)) {
                Some(message) => call.reply(message),
                None => call.refuse("expected an empty request in little-endian CDR"),
            }
        }
    }
    Ok(())
}

/// Announces `describe` and the questions of each new twin. The services of an ended twin stay and answer with the reason.
fn announce(
    link: &Link,
    names: &Names,
    twins: &Twins,
    known: &mut BTreeMap<String, Vec<Service>>,
    (sender, questions): (&SyncSender<Call<String>>, &SyncSender<Call<Asking>>),
) -> anyhow::Result<()> {
    for name in twins.names() {
        if known.contains_key(name) {
            continue;
        }
        let first = FIRST + known.len() * (1 + Question::ALL.len());
        let service = format!("softtwin/{name}/describe");
        let announced = Announced { number: first, name: &service, of: TRIGGER };
        let mut services = vec![Service::declare(link, names, &announced, name.to_owned(), sender.clone())?];
        let actuator = twins.actuator(name).unwrap_or(name);
        for (number, question) in (first + 1..).zip(Question::ALL) {
            let (kind, of) = question.service();
            let service = format!("softtwin/{name}/{kind}");
            let announced = Announced { number, name: &service, of };
            let asking = Asking { actuator: actuator.to_owned(), question };
            services.push(Service::declare(link, names, &announced, asking, questions.clone())?);
        }
        known.insert(name.to_owned(), services);
    }
    Ok(())
}
