//! What programs of a domain leave behind when they are killed, and how it is told from what is in use.
//!
//! iceoryx2 makes every resource in several steps (create, size, fill, final permissions). A program that is killed between
//! two steps leaves a half-made resource, and others wait for it to be finished. iceoryx2 removes what a dead program
//! completed, but nothing that is half-made. This module removes the rest, see docs/iceoryx2.md.
//!
//! Nothing here is decided by age or process id. A program keeps every file that it makes open (or mapped) for as long as it
//! uses it, and the kernel closes it when the program ends: [`unused`] asks the kernel whether anybody has a file open.

mod events;
mod half_made;
mod lock;
mod nodes;
mod places;
mod share;
mod sweep;
mod unused;
mod watch;

pub(crate) use places::Places;
pub use sweep::Removed;
pub(crate) use unused::names_this_file;
pub(crate) use watch::Watch;
