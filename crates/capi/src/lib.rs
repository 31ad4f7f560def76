//! The C interface of the wire and of models: installed as `libsofttwin` with the header `include/softtwin.h`. Payloads and numbers are
//! in `include/softtwin_layout.h`, which is generated from the wire's definitions.
//!
//! Rules: every call that can fail returns a status and leaves its text with `softtwin_last_error`; handles are made by
//! `..._open` and ended by `..._close`, belong to the thread that made them (models: to all threads), and outlive their bus; nothing is copied but
//! payloads of fixed size; a panic never crosses the FFI boundary.

#![allow(non_camel_case_types)] // names are those of C
#![cfg_attr(
    not(test),
    deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::indexing_slicing)
)]

mod bus;
mod ffi;
mod model;
mod reader;
mod stepping;
mod writer;

pub use bus::*;
pub use ffi::{softtwin_last_error, softtwin_layout_version, softtwin_now_ns, softtwin_status};
pub use model::*;
pub use reader::*;
pub use stepping::*;
pub use writer::*;
