//! Readers of topics: payloads of fixed size are copied, fields are not.

use crate::border::{Failure, argument, call, give, handle, name, put, take, text};
use crate::bus::softtwin_bus;
use crate::status::softtwin_status;
use std::ffi::{c_char, c_int, c_void};
use std::time::{Duration, Instant};
use wire::{AnyReader, AnySample, FieldHeader, FieldSample, Topic, WakeSet, Wakeable};

/// A reader of one topic.
pub struct softtwin_reader {
    reader: AnyReader,
    wake: WakeSet,
}

/// A received field. Its memory stays as it is until `softtwin_field_release`; at most 4 may be held of one topic.
pub struct softtwin_field(FieldSample);

impl softtwin_reader {
    /// The oldest or newest waiting sample; waits for one at most `timeout_ms`. Below 0: for ever.
    fn next(&mut self, newest: bool, timeout_ms: i64) -> Result<AnySample, Failure> {
        let end = u64::try_from(timeout_ms).ok().map(|ms| Instant::now() + Duration::from_millis(ms));
        loop {
            let found = if newest { self.reader.newest() } else { self.reader.next() };
            if let Some(found) = found? {
                return Ok(found);
            }
            let left =
                end.map_or(Duration::from_secs(3600), |end| end.saturating_duration_since(Instant::now()));
            if left.is_zero() {
                let text = format!("nothing came within {timeout_ms} ms");
                return Err(Failure::Own(softtwin_status::SOFTTWIN_TIMEOUT, text));
            }
            self.wake.wait(left)?;
        }
    }
}

/// The topic `softtwin/<name>/<kind>`.
pub(crate) fn topic(name: &str, kind: &str) -> Result<Topic, Failure> {
    let full = format!("softtwin/{name}/{kind}");
    Topic::parse(&full).ok_or_else(|| {
        argument(&format!("`{full}` is no topic; names have 1 to 31 letters, digits, `_` or `-`"))
    })
}

/// Opens a reader of `softtwin/<name>/<kind>` (kinds: docs/wire.md); `node_set` null: all nodes. The topic must exist.
///
/// # Safety
/// `bus` is live, texts are zero-terminated (`node_set` may be null), `out` points to memory for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_reader_open(
    bus: *mut softtwin_bus,
    name_: *const c_char,
    kind: *const c_char,
    node_set: *const c_char,
    out: *mut *mut softtwin_reader,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let (bus, owner, kind, set) = unsafe { (handle(bus)?, name(name_)?, name(kind)?, text(node_set)?) };
        let topic = match set {
            Some(set) => Topic::field(owner, Some(set))?,
            None => topic(owner, kind)?,
        };
        let reader = AnyReader::open(&bus.0, &topic)?;
        let wake = WakeSet::new([&reader as &dyn Wakeable]);
        // SAFETY: by the caller's promise.
        unsafe { give(out, softtwin_reader { reader, wake }) }
    })
}

/// Copies the oldest waiting sample (`newest` not 0: the newest) to `payload`, which has room for `size` bytes; waits for
/// one at most `timeout_ms` (0: does not wait, below 0: for ever).
///
/// # Safety
/// `reader` is live and used by its own thread, `payload` points to `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_reader_read(
    reader: *mut softtwin_reader,
    newest: c_int,
    timeout_ms: i64,
    payload: *mut c_void,
    size: usize,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let found = unsafe { handle(reader) }?.next(newest != 0, timeout_ms)?;
        let bytes = found.view().bytes;
        if payload.is_null() || bytes.len() != size || matches!(found, AnySample::Field(_)) {
            return Err(argument(&format!(
                "a {} of {} bytes was received, room was given for another payload",
                found.view().layout.name,
                bytes.len()
            )));
        }
        // SAFETY: `payload` has room for `size` bytes by the caller's promise; our own sample does not overlap with it.
        unsafe { std::ptr::copy_nonoverlapping(bytes.as_ptr(), payload.cast(), size) };
        Ok(())
    })
}

/// The oldest waiting field (`newest` not 0: the newest), without a copy; waits as `softtwin_reader_read`. Release it.
///
/// # Safety
/// `reader` is live and used by its own thread, `out` points to memory for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_reader_read_field(
    reader: *mut softtwin_reader,
    newest: c_int,
    timeout_ms: i64,
    out: *mut *mut softtwin_field,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        match unsafe { handle(reader) }?.next(newest != 0, timeout_ms)? {
            // SAFETY: by the caller's promise.
            AnySample::Field(field) => unsafe { give(out, softtwin_field(field)) },
            _ => Err(argument("this reader's topic has no fields")),
        }
    })
}

/// Ends a reader.
///
/// # Safety
/// `reader` is null or came from `softtwin_reader_open` and is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_reader_close(reader: *mut softtwin_reader) {
    // SAFETY: by the caller's promise.
    unsafe { take(reader) }
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
/// `field` is null or came from `softtwin_reader_read_field` and is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_field_release(field: *mut softtwin_field) {
    // SAFETY: by the caller's promise.
    unsafe { take(field) }
}
