//! Tests of writing, crashes and reading, in one program that is linked once.

mod clock;
mod common;
mod crash;
mod export;
mod messages;
mod recorder;
mod reference;
mod series;
