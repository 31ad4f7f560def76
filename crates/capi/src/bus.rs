//! Membership in a shared-memory domain.

use crate::ffi::{call, take, text, write_handle};
use crate::status::softtwin_status;
use std::ffi::c_char;
use wire::layout::regime;
use wire::{Bus, Domain};

pub struct softtwin_bus {
    pub(crate) bus: Bus,
}

/// # Safety
/// Strings are null or zero-terminated; `out` points to memory for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_bus_open(
    domain: *const c_char,
    root: *const c_char,
    out: *mut *mut softtwin_bus,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let (name, root) = unsafe { (text(domain)?, text(root)?) };
        let bus = Bus::open(&Domain::given(name, root))?;
        // SAFETY: by the caller's promise.
        unsafe { write_handle(out, softtwin_bus { bus }) }
    })
}

/// # Safety
/// `bus` is null or came from `softtwin_bus_open` and is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_bus_close(bus: *mut softtwin_bus) {
    // SAFETY: by the caller's promise.
    unsafe { take(bus) }
}

#[unsafe(no_mangle)]
pub extern "C" fn softtwin_regime_name(regime: u32) -> *const c_char {
    let name = match regime {
        regime::FREE => c"free",
        regime::CONTACT => c"contact",
        _ => c"unknown",
    };
    name.as_ptr()
}
