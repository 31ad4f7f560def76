//! The boundary to C: strings and handles in, statuses and the text of the last failure out; panics are caught.

use std::borrow::Cow;
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};
use wire::WireError;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C)]
pub enum softtwin_status {
    SOFTTWIN_OK = 0,
    SOFTTWIN_TIMEOUT = 1,
    SOFTTWIN_ABSENT = 2,
    SOFTTWIN_INCOMPATIBLE = 3,
    SOFTTWIN_TAKEN = 4,
    SOFTTWIN_ARGUMENT = 5,
    SOFTTWIN_FAILED = 6,
    SOFTTWIN_REFUSED = 7,
}

thread_local! {
    static LAST: RefCell<Cow<'static, CStr>> = const { RefCell::new(Cow::Borrowed(c"")) };
}

#[unsafe(no_mangle)]
pub extern "C" fn softtwin_last_error() -> *const c_char {
    LAST.with_borrow(|text| text.as_ptr())
}

#[unsafe(no_mangle)]
pub extern "C" fn softtwin_layout_version() -> u32 {
    wire::layout::LAYOUT_VERSION
}

#[unsafe(no_mangle)]
pub extern "C" fn softtwin_now_ns() -> u64 {
    wire::now_ns()
}

/// Keeps the text and passes the status on.
fn fail(status: softtwin_status, text: impl Into<Vec<u8>>) -> softtwin_status {
    let mut text = text.into();
    text.retain(|byte| *byte != 0);
    LAST.set(Cow::Owned(CString::new(text).unwrap_or_default()));
    status
}

/// Nothing came in time.
fn timed_out() -> softtwin_status {
    LAST.set(Cow::Borrowed(c"nothing came within the time that was given"));
    softtwin_status::SOFTTWIN_TIMEOUT
}

/// The status of a failure of the wire.
fn status_of(error: &WireError) -> softtwin_status {
    let status = match error {
        WireError::NoSuchTopic { .. } | WireError::NobodyAnswers { .. } => softtwin_status::SOFTTWIN_ABSENT,
        WireError::Incompatible { .. } => softtwin_status::SOFTTWIN_INCOMPATIBLE,
        WireError::AlreadyPublished { .. }
        | WireError::TooManyReaders { .. }
        | WireError::TooManyClients { .. }
        | WireError::TooManyPrograms { .. } => softtwin_status::SOFTTWIN_TAKEN,
        WireError::NoAnswer { .. } => softtwin_status::SOFTTWIN_TIMEOUT,
        WireError::BadName { .. } => softtwin_status::SOFTTWIN_ARGUMENT,
        error if error.is_configuration() => softtwin_status::SOFTTWIN_ARGUMENT,
        _ => softtwin_status::SOFTTWIN_FAILED,
    };
    fail(status, error.to_string())
}

/// Runs a call; an error becomes a status with a message.
pub(crate) fn call(body: impl FnOnce() -> Result<(), Failure>) -> softtwin_status {
    match catch_unwind(AssertUnwindSafe(body)) {
        Ok(Ok(())) => softtwin_status::SOFTTWIN_OK,
        Ok(Err(Failure::Wire(error))) => status_of(&error),
        Ok(Err(Failure::Own(status, text))) => fail(status, text),
        Ok(Err(Failure::Timeout)) => timed_out(),
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

/// A handle from C that several threads may use.
///
/// # Safety
/// `handle` is null or came from the `..._open` of its type and was not closed.
pub(crate) unsafe fn shared<'a, T>(handle: *const T, what: &str) -> Result<&'a T, Failure> {
    // SAFETY: by the caller's promise it points to a live value.
    unsafe { handle.as_ref() }.ok_or_else(|| argument(&format!("{what} is null")))
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
