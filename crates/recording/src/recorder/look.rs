//! The look for topics. It reads the domain's folder, which a busy disk holds up for seconds: in a thread of its own.

use std::collections::BTreeSet;
use std::sync::mpsc::Sender;
use std::time::Duration;

use wire::{Bus, Domain, KeyExpr, Topic, WireError};

use super::crew::Stop;

/// How often it is looked.
const EVERY: Duration = Duration::from_millis(250);

/// Topics that were not there at the look before, or why it failed.
pub type Look = Result<Vec<Topic>, WireError>;

/// An eye for the topics of `domain` that any of `keys` matches. It joins the domain at its first look.
pub fn eye(domain: Domain, keys: Vec<KeyExpr>) -> impl FnMut() -> Look {
    let mut bus = None;
    move || {
        let bus = match &mut bus {
            Some(bus) => bus,
            none => none.insert(Bus::open(&domain)?),
        };
        let mut found = Vec::new();
        for key in &keys {
            found.extend(bus.names(key)?);
        }
        Ok(found)
    }
}

/// Looks again and again, reports what is new.
pub fn keep_looking(mut eye: impl FnMut() -> Look, news: &Sender<Look>, stop: &Stop) {
    let mut seen = BTreeSet::new();
    while !stop.is_set() {
        let look = eye().map(|mut topics| {
            topics.retain(|topic| seen.insert(topic.name().to_owned()));
            topics
        });
        // Nobody listens any more: the stop flag is about to be set.
        let _ = news.send(look);
        stop.pause(EVERY);
    }
}
