//! Synthetic databases, shared with the tests of all crates.

#[allow(dead_code, missing_docs, reason = "shared with the tests of other crates")]
#[path = "../../tests/src/synthetic/mod.rs"]
mod shared;

pub use shared::*;
