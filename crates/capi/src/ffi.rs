//! FFI boundary: strings and handles in, statuses out; panics are caught.

use crate::status::{self, fail, softtwin_status};
use std::ffi::{CStr, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};
use wire::WireError;

/// Runs a call; an error becomes a status with a message.
pub(crate) fn call(body: impl FnOnce() -> Result<(), Failure>) -> softtwin_status {
    match catch_unwind(AssertUnwindSafe(body)) {
        Ok(Ok(())) => softtwin_status::SOFTTWIN_OK,
        Ok(Err(Failure::Wire(error))) => status::of(&error),
        Ok(Err(Failure::Own(status, text))) => fail(status, text),
        Ok(Err(Failure::Timeout)) => status::timed_out(),
        Err(_) => {
            fail(softtwin_status::SOFTTWIN_FAILED, "softtwin failed inside; please report what you did")
        }
    }
}

/// Error of a call.
pub(crate) enum Failure {
    Wire(WireError),
    Own(softtwin_status, String),
    /// Usual in a loop: it allocates nothing.
    Timeout,
}

impl From<WireError> for Failure {
    fn from(error: WireError) -> Self {
        Self::Wire(error)
    }
}

pub(crate) fn argument(text: &str) -> Failure {
    Failure::Own(softtwin_status::SOFTTWIN_ARGUMENT, text.to_owned())
}

/// String from C; `None` if null.
///
/// # Safety
/// `text` is null or a zero-terminated string that lives across the use of the result.
pub(crate) unsafe fn text<'a>(text: *const c_char) -> Result<Option<&'a str>, Failure> {
    if text.is_null() {
        return Ok(None);
    }
    // SAFETY: not null, and zero-terminated and alive by the caller's promise.
    let text = unsafe { CStr::from_ptr(text) };
    text.to_str().map(Some).map_err(|_| argument("a string is not UTF-8"))
}

/// Required name from C.
///
/// # Safety
/// As [`text`].
pub(crate) unsafe fn name<'a>(from: *const c_char) -> Result<&'a str, Failure> {
    // SAFETY: passed on.
    unsafe { text(from) }?.ok_or_else(|| argument("a name is null"))
}

/// A handle from C.
///
/// # Safety
/// `handle` is null or came from the `..._open` of its type, was not closed, and is used by one thread.
pub(crate) unsafe fn handle<'a, T>(handle: *mut T) -> Result<&'a mut T, Failure> {
    // SAFETY: by the caller's promise it points to a live value without other users.
    unsafe { handle.as_mut() }.ok_or_else(|| argument("a handle is null"))
}

/// Gives a new value to C.
///
/// # Safety
/// `out` is null or points to writable memory for a pointer.
pub(crate) unsafe fn write_handle<T>(out: *mut *mut T, value: T) -> Result<(), Failure> {
    if out.is_null() {
        return Err(argument("the place for the result is null"));
    }
    // SAFETY: not null, and writable by the caller's promise.
    unsafe { out.write(Box::into_raw(Box::new(value))) };
    Ok(())
}

/// Writes a plain value to C.
///
/// # Safety
/// `out` is null or points to writable memory for a `T`.
pub(crate) unsafe fn put<T: Copy>(out: *mut T, value: T) -> Result<(), Failure> {
    if out.is_null() {
        return Err(argument("the place for the result is null"));
    }
    // SAFETY: not null, and writable by the caller's promise.
    unsafe { out.write(value) };
    Ok(())
}

/// Ends a handle; null is nothing to do.
///
/// # Safety
/// `handle` is null or came from [`write_handle`] and is not used any more.
pub(crate) unsafe fn take<T>(handle: *mut T) {
    if !handle.is_null() {
        // SAFETY: by the caller's promise it came out of `Box::into_raw` in `write_handle` and is given back once.
        drop(unsafe { Box::from_raw(handle) });
    }
}
