//! Passes the queries of ROS to the twins one after the other, on a dedicated thread: a twin may take a second.

use super::question::{Question, refusal, response};
use super::service::Call;
use crate::link::Link;
use crate::queries::Clients;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Duration;

/// Largest number of waiting queries.
const CALLS: usize = 64;
/// Longest sleep.
const TICK: Duration = Duration::from_millis(100);

/// A query and its actuator.
#[derive(Debug, Clone)]
pub struct Asking {
    /// Local name of the actuator.
    pub actuator: String,
    /// Kind of the query.
    pub question: Question,
}

/// Both ends of the queue of queries.
pub fn channel() -> (SyncSender<Call<Asking>>, Receiver<Call<Asking>>) {
    sync_channel(CALLS)
}

/// Answers until the gateway ends.
///
/// # Errors
/// When the shared memory cannot be opened.
pub fn run(link: &Link, calls: &Receiver<Call<Asking>>) -> anyhow::Result<()> {
    let mut clients = Clients::open(link)?;
    while link.is_running() {
        let Ok(call) = calls.recv_timeout(TICK) else { continue };
        match answer(&mut clients, &call.what, &call.request) {
            Ok(message) => call.reply(message),
            Err(text) => call.refuse(&text),
        }
    }
    Ok(())
}

/// The response to a request.
///
/// # Errors
/// Malformed requests.
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
