//! The C face of the wire: `libsofttwin`, header `include/softtwin.h` (generated, see `tests/header.rs`).
//!
//! Rules: every call that can fail returns a status and leaves its text with `softtwin_last_error`; handles are made by
//! `..._open` and ended by `..._close`, belong to the thread that made them, and outlive their bus; nothing is copied but
//! payloads of fixed size; a panic never crosses the border.

#![allow(non_camel_case_types)] // names are those of C
#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::indexing_slicing)
)]

mod border;
mod bus;
mod field;
mod query;
mod sized;
mod status;

pub use bus::*;
pub use field::*;
pub use query::*;
pub use sized::*;
pub use status::*;
