//! Fields, without a copy: a handle keeps the shared memory it looks at.

use crate::border::{argument, call, give, handle, name, put, take, text};
use crate::bus::softtwin_bus;
use crate::sized::Waiting;
use crate::status::softtwin_status;
use std::ffi::c_char;
use wire::{FieldHeader, FieldReader, FieldSample, Topic};

/// A reader of `softtwin/<actuator>/field` or `softtwin/<actuator>/field/<set>`.
pub struct softtwin_field_reader(Waiting<FieldReader>);

/// A received field. Its memory stays as it is until `softtwin_field_release`; at most 4 may be held of one topic.
pub struct softtwin_field(FieldSample);

/// Opens a reader of fields; `node_set` null: all nodes. The topic must exist.
///
/// # Safety
/// `bus` is live, texts are zero-terminated (`node_set` may be null), `out` points to memory for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_field_reader_open(
    bus: *mut softtwin_bus,
    actuator: *const c_char,
    node_set: *const c_char,
    out: *mut *mut softtwin_field_reader,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let (bus, name, set) = unsafe { (handle(bus)?, name(actuator)?, text(node_set)?) };
        let reader = FieldReader::open(&bus.0, &Topic::field(name, set)?)?;
        // SAFETY: by the caller's promise.
        unsafe { give(out, softtwin_field_reader(Waiting::new(reader))) }
    })
}

/// The oldest waiting field; waits for one at most `timeout_ms` (0: does not wait, below 0: for ever). Release it.
///
/// # Safety
/// `reader` is live and used by its own thread, `out` points to memory for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_field_reader_next(
    reader: *mut softtwin_field_reader,
    timeout_ms: i64,
    out: *mut *mut softtwin_field,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let found = unsafe { handle(reader) }?.0.next(timeout_ms, FieldReader::next)?;
        // SAFETY: by the caller's promise.
        unsafe { give(out, softtwin_field(found)) }
    })
}

/// As `softtwin_field_reader_next`, with the newest waiting field; older ones are given back.
///
/// # Safety
/// As `softtwin_field_reader_next`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_field_reader_newest(
    reader: *mut softtwin_field_reader,
    timeout_ms: i64,
    out: *mut *mut softtwin_field,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let found = unsafe { handle(reader) }?.0.next(timeout_ms, FieldReader::newest)?;
        // SAFETY: by the caller's promise.
        unsafe { give(out, softtwin_field(found)) }
    })
}

/// The header, in shared memory.
///
/// # Safety
/// `field` is null or live.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_field_get_header(field: *const softtwin_field) -> *const FieldHeader {
    // SAFETY: null or live by the caller's promise.
    unsafe { field.as_ref() }.map_or(std::ptr::null(), |field| std::ptr::from_ref(field.0.header()))
}

/// The values of one field (`SOFTTWIN_FIELD_X`, ...) in shared memory, one a node.
///
/// # Safety
/// `field` is live, `values` and `count` point to writable memory.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_field_values(
    field: *const softtwin_field,
    field_id: u8,
    values: *mut *const f32,
    count: *mut usize,
) -> softtwin_status {
    call(|| {
        // SAFETY: null or live by the caller's promise.
        let field = unsafe { field.as_ref() }.ok_or_else(|| argument("the field is null"))?;
        let found = field.0.field(field_id).ok_or_else(|| {
            argument(&format!("field {field_id} is not in this sample; see field_ids of its header"))
        })?;
        // SAFETY: by the caller's promise.
        unsafe { put(values, found.as_ptr()).and_then(|()| put(count, found.len())) }
    })
}

/// Gives the memory of a field back.
///
/// # Safety
/// `field` is null or came from a field reader and is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_field_release(field: *mut softtwin_field) {
    // SAFETY: by the caller's promise.
    unsafe { take(field) }
}

/// Ends a reader.
///
/// # Safety
/// `reader` is null or came from `softtwin_field_reader_open` and is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_field_reader_close(reader: *mut softtwin_field_reader) {
    // SAFETY: by the caller's promise.
    unsafe { take(reader) }
}
