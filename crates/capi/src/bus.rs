//! The bus: membership in a shared-memory domain, waiting for several readers at once, questions to a twin.

use crate::ffi::{Failure, argument, call, handle, name, put, softtwin_status, take, text, write_handle};
use crate::reader::softtwin_reader;
use std::ffi::{c_char, c_int};
use std::os::fd::{AsRawFd, OwnedFd};
use std::time::Duration;
use wire::layout::regime;
use wire::{Answer, Bus, Domain, Query, QueryClient, Wake, WakeSet, Wakeable};

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

/// Waits for several readers at once, by a call or by a descriptor of the program's own event loop.
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

pub struct softtwin_client(QueryClient);

/// # Safety
/// `bus` is live, `actuator` zero-terminated, `out` points to memory for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_client_open(
    bus: *mut softtwin_bus,
    actuator: *const c_char,
    out: *mut *mut softtwin_client,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let (bus, name) = unsafe { (handle(bus)?, name(actuator)?) };
        let client = QueryClient::open(&bus.bus, name)?;
        // SAFETY: by the caller's promise.
        unsafe { write_handle(out, softtwin_client(client)) }
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn softtwin_query_new(kind: u32) -> Query {
    Query { kind, ..Query::default() }
}

/// # Safety
/// `client` is live and used by the thread that opened it, `query` and `answer` point to their structures, `values` to `capacity`
/// values (null when 0), `count` to memory for a number or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_client_ask(
    client: *mut softtwin_client,
    query: *const Query,
    timeout_ms: u32,
    answer: *mut Answer,
    values: *mut f32,
    capacity: usize,
    count: *mut usize,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let (client, query) = unsafe { (handle(client)?, query.as_ref()) };
        let query = query.ok_or_else(|| argument("the question is null"))?;
        let sample = client.0.ask(query, Duration::from_millis(timeout_ms.into()))?;
        // SAFETY: by the caller's promise.
        unsafe { put(answer, *sample.answer()) }?;
        if let Some(reason) = sample.answer().refusal() {
            return Err(Failure::Own(softtwin_status::SOFTTWIN_REFUSED, reason));
        }
        let found = sample.values();
        if !count.is_null() {
            // SAFETY: not null, and writable by the caller's promise.
            unsafe { count.write(found.len()) };
        }
        if found.len() > capacity || (values.is_null() && !found.is_empty()) {
            return Err(argument(&format!(
                "the field has {} values, the buffer has {capacity}",
                found.len()
            )));
        }
        if !found.is_empty() {
            // SAFETY: room for `capacity >= found.len()` values by the caller's promise; shared memory and the caller's
            // own do not overlap.
            unsafe { std::ptr::copy_nonoverlapping(found.as_ptr(), values, found.len()) };
        }
        Ok(())
    })
}

/// # Safety
/// `client` is null or came from `softtwin_client_open` and is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_client_close(client: *mut softtwin_client) {
    // SAFETY: by the caller's promise.
    unsafe { take(client) }
}
