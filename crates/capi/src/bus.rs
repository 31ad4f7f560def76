//! The bus: membership in a shared-memory domain, and questions to a twin.

use crate::ffi::{Failure, argument, call, handle, name, put, softtwin_status, take, text, write_handle};
use std::ffi::c_char;
use std::time::Duration;
use wire::layout::regime;
use wire::{Answer, Bus, Domain, Query, QueryClient};

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
