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
mod motion;
mod query;
mod reader;
mod status;
mod stepping;
mod waiter;
mod writer;

pub use bus::{softtwin_bus, softtwin_bus_close, softtwin_bus_open, softtwin_regime_name};
pub use model::{
    softtwin_model, softtwin_model_close, softtwin_model_describe, softtwin_model_field, softtwin_model_info,
    softtwin_model_input, softtwin_model_node_set, softtwin_model_open, softtwin_model_predict,
    softtwin_model_select, softtwin_prediction,
};
pub use motion::{
    softtwin_motion, softtwin_motion_close, softtwin_motion_open, softtwin_motion_reset, softtwin_motion_step,
};
pub use query::{
    softtwin_client, softtwin_client_ask, softtwin_client_close, softtwin_client_open, softtwin_query_new,
};
pub use reader::{
    softtwin_field, softtwin_field_get_header, softtwin_field_release, softtwin_field_values,
    softtwin_reader, softtwin_reader_attach, softtwin_reader_close, softtwin_reader_counts,
    softtwin_reader_open, softtwin_reader_read, softtwin_reader_read_field,
};
pub use status::{softtwin_last_error, softtwin_layout_version, softtwin_now_ns, softtwin_status};
pub use stepping::{
    softtwin_control, softtwin_control_close, softtwin_control_cycle, softtwin_control_fault_name,
    softtwin_control_inputs, softtwin_control_open, softtwin_control_reading, softtwin_control_release,
    softtwin_control_start, softtwin_control_step,
};
pub use waiter::{
    softtwin_waiter, softtwin_waiter_close, softtwin_waiter_descriptor, softtwin_waiter_open,
    softtwin_waiter_wait,
};
pub use writer::{
    softtwin_writer, softtwin_writer_close, softtwin_writer_open, softtwin_writer_open_setpoint,
    softtwin_writer_open_target, softtwin_writer_send_command, softtwin_writer_send_inputs,
    softtwin_writer_send_reading, softtwin_writer_send_setpoint, softtwin_writer_send_target,
};
