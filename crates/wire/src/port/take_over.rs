//! One program takes topics over from another that writes them, without a gap.
//!
//! ```text
//! new: ports without rights -> asks -> waits for the rights -> continues after the last state -> withdraws what it asked
//! old:                 writes on ... sees it -> gives the rights -> waits -> the rights are taken: ends
//!                                                                      \-> nobody asks any more: takes them again, goes on
//! ```
//!
//! Rights and requests are locks: the kernel takes them from a program that ends, however it ends. So whichever of the two is
//! killed, the other one has the topics.

use super::writer_lock::{PAUSE, WriterLock, try_until};
use crate::{Bus, Topic, WireError};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Behind a topic's name: the lock of who asks for it, and of a program as long as it lives.
const ASKED: &str = " take-over";
const LIVES: &str = " process";
/// A look at a lock may stand in the way of taking it, for microseconds.
const SECOND_TRY: Duration = Duration::from_millis(100);

/// A port whose right to write can be given away while its memory stays.
pub trait WriterRight {
    /// Takes the right to write, if nobody has it.
    ///
    /// # Errors
    /// [`WireError::AlreadyPublished`] when another one has it.
    fn take_right(&self) -> Result<(), WireError>;

    /// Gives the right away. Nothing may be published until it is taken again.
    fn give_right(&self);
}

/// Locks that a program holds while this value lives. May be sent to another thread.
#[derive(Debug)]
pub struct Held {
    _locks: Vec<WriterLock>,
}

/// Whether locks of another program are held. May be sent to another thread.
#[derive(Debug, Clone)]
pub struct HeldWatch {
    files: Vec<PathBuf>,
}

impl HeldWatch {
    /// Whether all of them are held by somebody who lives. Some microseconds each.
    pub fn all_held(&self) -> bool {
        !self.files.is_empty() && self.files.iter().all(|file| WriterLock::is_held(file))
    }
}

impl Bus {
    /// Asks the program that writes these topics to give them away, until the value is dropped.
    ///
    /// # Errors
    /// [`WireError::AlreadyPublished`] when another program asks.
    pub fn ask_to_take_over(&self, topics: &[Topic]) -> Result<Held, WireError> {
        self.hold(topics, ASKED, SECOND_TRY)
    }

    /// Looks whether somebody asks for all of these topics.
    pub fn take_over_watch(&self, topics: &[Topic]) -> HeldWatch {
        let file = |topic: &Topic| self.places.writer_lock(&format!("{}{ASKED}", topic.name()));
        HeldWatch { files: topics.iter().map(file).collect() }
    }

    /// Says that the program that serves these topics lives, until the value is dropped. Waits for an earlier one to end.
    ///
    /// # Errors
    /// [`WireError::AlreadyPublished`] when the earlier one has not ended within `patience`.
    pub fn hold_place(&self, topics: &[Topic], patience: Duration) -> Result<Held, WireError> {
        self.hold(topics, LIVES, patience)
    }

    fn hold(&self, topics: &[Topic], what: &str, patience: Duration) -> Result<Held, WireError> {
        let end = Instant::now() + patience;
        let take = |topic: &Topic| {
            try_until(end, || WriterLock::take(&self.places, &format!("{}{what}", topic.name()), ""))
        };
        Ok(Held { _locks: topics.iter().map(take).collect::<Result<_, _>>()? })
    }
}

/// Takes all rights or none.
///
/// # Errors
/// [`WireError::AlreadyPublished`] when another program has one of them.
pub fn take_rights(ports: &[&dyn WriterRight]) -> Result<(), WireError> {
    let taken = ports.iter().try_for_each(|port| port.take_right());
    if taken.is_err() {
        ports.iter().for_each(|port| port.give_right());
    }
    taken
}

/// As [`take_rights`], again and again until `end`.
///
/// # Errors
/// As [`take_rights`], at the end.
pub fn wait_for_rights(ports: &[&dyn WriterRight], end: Instant) -> Result<(), WireError> {
    loop {
        match take_rights(ports) {
            Err(WireError::AlreadyPublished { .. }) if Instant::now() < end => std::thread::sleep(PAUSE),
            other => return other,
        }
    }
}
