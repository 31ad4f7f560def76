//! Recordings: what is written, what a crash leaves, what is read. One program: linked once, and its tests run beside each other.

mod common;
mod crash;
mod export;
mod messages;
mod recorder;
mod reference;
mod series;
mod threads;
