//! A service of ROS 2: a queryable on the service's key, complete because clients ask complete ones only; the request is the query's
//! payload, the reply's attachment has the number and the client of the request's. See the design document of `rmw_zenoh` (docs/design.md
//! there), "Service Clients" and "Service Servers".

use super::attachment::{self, Gid, attachment, now_since_1970_ns};
use super::names::{Entity, Names, token};
use super::types::MessageType;
use crate::link::{Counters, Link, count, network};
use crate::topic_bridge::refuse;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError};
use zenoh::Wait;
use zenoh::liveliness::LivelinessToken;
use zenoh::query::{Query, Queryable};

/// Largest request.
const MAX_BYTES: usize = 64 * 1024;

/// A service to announce: its entity number within the node, name and type.
pub struct Announced<'a> {
    /// Entity number within the node.
    pub number: usize,
    /// Name without the first slash.
    pub name: &'a str,
    pub of: MessageType,
}

/// A service in the graph while it exists.
pub struct Service {
    _queryable: Queryable<()>,
    _token: LivelinessToken,
}

/// A request, with the tag of its service.
pub struct Call<T> {
    /// Tag of the service.
    pub what: T,
    /// The request, CDR.
    pub request: Vec<u8>,
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
    /// Announces a service; its requests go to `sender` with the tag `what`.
    ///
    /// # Errors
    /// When the session is closed.
    pub fn declare<T: Clone + Send + Sync + 'static>(
        link: &Link,
        names: &Names,
        announced: &Announced,
        what: T,
        sender: SyncSender<Call<T>>,
    ) -> anyhow::Result<Self> {
        let Announced { number, name, of } = *announced;
        let context = Arc::new(Context {
            key: names.key(name, of, of.hash),
            counters: link.counters.clone(),
            is_logged: AtomicBool::new(false),
        });
        let take = move |query: Query| match accept(&query, of) {
            Ok((request, number, client)) => {
                let (what, context) = (what.clone(), context.clone());
                let call = Call { what, request, number, client, query, context };
                if let Err(TrySendError::Full(call) | TrySendError::Disconnected(call)) =
                    sender.try_send(call)
                {
                    call.refuse("too many requests wait here; ask again later");
                }
            }
            Err(text) => context.refuse(&query, &text),
        };
        // With any hash: a wrong one is reported.
        let queryable =
            link.session.declare_queryable(names.key(name, of, "*")).complete(true).callback(take);
        let queryable = network(queryable.wait())?;
        let endpoint = names.endpoint(number, Entity::Service, name, of);
        Ok(Self { _queryable: queryable, _token: token(link, endpoint)? })
    }
}

/// Request, number and client of a query.
///
/// # Errors
/// A query of another type, too long, or without its attachment.
fn accept(query: &Query, of: MessageType) -> Result<(Vec<u8>, i64, Gid), String> {
    let key = query.key_expr().as_str();
    of.check_hash(key)?;
    let length = query.payload().map_or(0, |payload| payload.len());
    if length > MAX_BYTES {
        return Err(format!("{key}: expected at most {MAX_BYTES} bytes, found {length}"));
    }
    let beside = query.attachment().and_then(|bytes| attachment::parse(&bytes.to_bytes()));
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

impl<T> Call<T> {
    /// Answers with a message.
    pub fn reply(&self, message: Vec<u8>) {
        let beside = attachment(self.number, now_since_1970_ns(), self.client);
        match self.query.reply(self.context.key.as_str(), message).attachment(beside).wait() {
            Ok(()) => count(&self.context.counters.answers),
            Err(error) => tracing::debug!("{}: the client has ended: {error}", self.context.key),
        }
    }

    /// Refuses.
    pub fn refuse(&self, text: &str) {
        self.context.refuse(&self.query, &format!("{}: {text}", self.context.key));
    }
}
