//! The live view: a page in any browser, fed from shared memory.
//!
//! One thread ([`reader`]) reads the newest field and state of every actuator, only while somebody looks, and puts them
//! into one slot an actuator ([`hub`]): a newer frame replaces an older one. Each page has its own task ([`client`])
//! that takes a frame when the page says it has drawn the last one, so slow pages skip frames, queue nothing, and the
//! twin never waits for anybody. A [`player`] takes the reader's place for recordings. [`server`] hands out the page; [`guard`] decides who may have it.

mod catalogue;
mod client;
mod frame;
mod grasp;
mod guard;
mod hub;
mod player;
mod reader;
mod server;

pub use catalogue::{Catalogue, Stand};
pub use guard::Guard;
pub use hub::Hub;
pub use player::{Command, Library, Player};
pub use reader::Reader;
pub use server::{Server, open_port};
