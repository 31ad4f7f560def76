//! Passes the questions of ROS on to the twins, one after the other, in a thread of its own: a twin may take a second.

use super::question::{Question, refusal, response};
use super::service::Call;
use crate::link::Link;
use crate::queries::Clients;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Duration;

/// Questions that may wait.
const CALLS: usize = 64;
/// Longest sleep.
const TICK: Duration = Duration::from_millis(100);

/// What is asked of whose twin.
#[derive(Debug, Clone)]
pub struct Asking {
    /// The actuator, by its name in the domain.
    pub actuator: String,
    /// What.
    pub question: Question,
}

/// A place for questions, and where they are taken from.
pub fn channel() -> (SyncSender<Call<Asking>>, Receiver<Call<Asking>>) {
    sync_channel(CALLS)
}

/// Answers until the gateway ends.
///
/// # Errors
/// When the domain cannot be joined.
pub fn run(link: &Link, calls: &Receiver<Call<Asking>>) -> anyhow::Result<()> {
    let mut clients = Clients::open(link)?;
    while link.goes_on() {
        let Ok(call) = calls.recv_timeout(TICK) else { continue };
        match answer(&mut clients, &call.what, &call.request) {
            Ok(message) => call.reply(message),
            Err(text) => call.refuse(&text),
        }
    }
    Ok(())
}

/// The response; what is wrong with a request that is none.
fn answer(clients: &mut Clients, asking: &Asking, request: &[u8]) -> Result<Vec<u8>, String> {
    let query = match asking.question.read(request)? {
        Ok(query) => query,
        Err(reason) => return Ok(refusal(&reason)),
    };
    Ok(match clients.ask(&asking.actuator, &query) {
        Ok(sample) => response(sample.answer(), sample.values()),
        Err(error) => refusal(&error.to_string()),
    })
}
