//! Answers what nodes of ROS ask of this one, in a thread of its own.

use super::config::Ros2;
use super::names::{Names, QOS_PARAMETERS};
use super::parameter_services::Access;
use super::parameters;
use super::service::{Announced, Call, Service};
use super::twins::Twins;
use crate::link::Link;
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

/// Answers until the gateway ends.
///
/// # Errors
/// When the domain cannot be joined or the session is closed.
pub fn run(link: &Link, ros: &Ros2, keys: &[KeyExpr]) -> anyhow::Result<()> {
    let mut twins = Twins::open(link, keys)?;
    let (sender, calls) = sync_channel(CALLS);
    let _services = announce(link, ros, &sender)?;
    let mut waiting: Vec<(Call<Access>, Instant)> = Vec::new();
    while link.goes_on() {
        twins.scan(Instant::now())?;
        let arrived = calls.recv_timeout(if waiting.is_empty() { TICK } else { PACE });
        let now = Instant::now();
        for call in arrived.into_iter().chain(calls.try_iter().take(CALLS.saturating_sub(waiting.len()))) {
            if call.what.needs_values() {
                twins.want(now);
            }
            waiting.push((call, now + PATIENCE));
        }
        twins.pump(now);
        for (call, _) in waiting.extract_if(.., |(call, until)| {
            !call.what.needs_values() || twins.are_all_here() || now >= *until
        }) {
            let parameters = parameters::all(ros, &twins);
            match call.what.answer(&call.request, &parameters) {
                Ok(message) => call.reply(message),
                Err(text) => call.refuse(&text),
            }
        }
    }
    Ok(())
}

/// The services through which others see the node's parameters.
fn announce(link: &Link, ros: &Ros2, sender: &SyncSender<Call<Access>>) -> anyhow::Result<Vec<Service>> {
    let names = Names::new(ros, link);
    let declare = |(at, access): (usize, Access)| {
        let (name, of) = access.service();
        let name = format!("{}/{name}", ros.node);
        let announced = Announced { number: FIRST + at, name: &name, of, qos: QOS_PARAMETERS };
        Service::declare(link, &names, &announced, access, sender.clone())
    };
    Access::ALL.into_iter().enumerate().map(declare).collect()
}
