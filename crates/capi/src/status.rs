//! Statuses and the text of the last failure.

use std::borrow::Cow;
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};
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
pub(crate) fn fail(status: softtwin_status, text: impl Into<Vec<u8>>) -> softtwin_status {
    let mut text = text.into();
    text.retain(|byte| *byte != 0);
    LAST.set(Cow::Owned(CString::new(text).unwrap_or_default()));
    status
}

/// Nothing came in time.
pub(crate) fn timed_out() -> softtwin_status {
    LAST.set(Cow::Borrowed(c"nothing came within the time that was given"));
    softtwin_status::SOFTTWIN_TIMEOUT
}

/// The status of a failure of the wire.
pub(crate) fn of(error: &WireError) -> softtwin_status {
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
