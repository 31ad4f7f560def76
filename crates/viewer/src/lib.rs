//! The live view: a page in any browser, fed from shared memory.
//!
//! One thread ([`reader`]) reads the newest field and state of every actuator while there are viewers, and puts them into
//! the [`hub`], which keeps the newest frame of each actuator and the last seconds of [`readings`]. Each page has a task ([`client`])
//! that sends a frame when the browser has drawn the last one. So slow pages skip frames, nothing is queued, and the twin never waits. For
//! recordings a [`player`] replaces the reader. [`server`] serves the browser, [`guard`] decides who may have it. [`saved`] makes a page
//! that needs none of them.

#![forbid(unsafe_code)]

mod catalogue;
mod client;
mod frame;
mod grasp;
mod guard;
mod hub;
mod pictures;
mod player;
mod reader;
mod readings;
mod saved;
mod server;

pub use catalogue::{Catalogue, NamedModel, Stand};
pub use client::{Shared, is_request};
pub use guard::Guard;
pub use hub::Hub;
pub use pictures::Picture;
pub use player::{Command, Library, Player};
pub use reader::Reader;
pub use saved::{can_save, page};
pub use server::{Server, open_port};
