//! Waiting for several readers at once, by a call or by a descriptor of the program's own event loop.

use crate::ffi::{Failure, argument, call, handle, put, take, write_handle};
use crate::reader::softtwin_reader;
use crate::status::softtwin_status;
use std::ffi::c_int;
use std::os::fd::{AsRawFd, OwnedFd};
use std::time::Duration;
use wire::{Wake, WakeSet, Wakeable};

pub struct softtwin_waiter {
    wake: WakeSet,
    /// Made when it is asked for.
    descriptor: Option<OwnedFd>,
}

/// Makes a waiter over `count` readers. A reader that is never woken may be among them and ends no wait. The waiter keeps what it
/// needs of the readers; after one of them is closed it no longer ends a wait.
///
/// # Safety
/// `readers` points to `count` live readers, all of this thread; `out` points to memory for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_waiter_open(
    readers: *mut *mut softtwin_reader,
    count: usize,
    out: *mut *mut softtwin_waiter,
) -> softtwin_status {
    call(|| {
        if readers.is_null() {
            return Err(argument("the list of readers is null"));
        }
        let mut all = Vec::with_capacity(count);
        for at in 0..count {
            // SAFETY: the list has `count` entries, each a live reader, by the caller's promise.
            all.push(unsafe { &*handle(*readers.add(at))? });
        }
        let wake = WakeSet::new(all.into_iter().map(|reader| reader.wakeable() as &dyn Wakeable));
        // SAFETY: by the caller's promise.
        unsafe { write_handle(out, softtwin_waiter { wake, descriptor: None }) }
    })
}

/// # Safety
/// `waiter` is live and used by the thread that opened it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_waiter_wait(
    waiter: *mut softtwin_waiter,
    timeout_us: i64,
) -> softtwin_status {
    call(|| {
        let timeout = u64::try_from(timeout_us).map_or(Duration::MAX, Duration::from_micros);
        // SAFETY: by the caller's promise.
        match unsafe { handle(waiter) }?.wake.wait(timeout)? {
            Wake::Event | Wake::Signal => Ok(()),
            Wake::Timeout => Err(Failure::Timeout),
        }
    })
}

/// # Safety
/// `waiter` is live and used by the thread that opened it, `descriptor` points to writable memory.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_waiter_descriptor(
    waiter: *mut softtwin_waiter,
    descriptor: *mut c_int,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let waiter = unsafe { handle(waiter) }?;
        if waiter.descriptor.is_none() {
            waiter.descriptor = Some(waiter.wake.descriptor()?);
        }
        let found = waiter.descriptor.as_ref().map_or(-1, AsRawFd::as_raw_fd);
        // SAFETY: by the caller's promise.
        unsafe { put(descriptor, found) }
    })
}

/// # Safety
/// `waiter` is null or came from `softtwin_waiter_open` and is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_waiter_close(waiter: *mut softtwin_waiter) {
    // SAFETY: by the caller's promise.
    unsafe { take(waiter) }
}
