//! Leftovers of killed programs in a shared-memory domain, and how they are distinguished from resources in use.
//!
//! iceoryx2 creates every resource in several steps (create, size, fill, final permissions). A program that is killed between
//! two steps leaves an incomplete resource, and others wait for its completion. iceoryx2 removes complete resources of dead
//! programs only. This module removes the incomplete ones, see docs/iceoryx2.md.
//!
//! No decision depends on age or process id. A program keeps every created file open (or mapped) while it uses it, and the
//! operating system closes it at the program's end, so that the operating system can be asked whether a file is in use.

mod places;
mod sweep;

pub use places::own_folder;
pub(crate) use places::{Places, claimed, ending, is_counter_of, number_of_ending, process_of};
pub use sweep::Removed;
pub(crate) use sweep::{SweepThread, names_this_file};
