//! Readers of topics, and waiting for several of them: payloads of fixed size are copied, fields are not.

use crate::bus::softtwin_bus;
use crate::ffi::{Failure, argument, call, handle, name, put, softtwin_status, take, text, write_handle};
use std::cell::RefCell;
use std::ffi::{c_char, c_int, c_void};
use std::mem::MaybeUninit;
use std::os::fd::{AsRawFd, OwnedFd};
use std::time::{Duration, Instant};
use wire::{
    AnyReader, AnySample, Arrivals, FieldHeader, FieldSample, Topic, Wake, WakeSet, Wakeable, Waking,
};

pub struct softtwin_reader {
    reader: AnyReader,
    wait: WakeSet,
    counts: Counts,
}

/// Counts of received and lost samples.
#[derive(Default)]
struct Counts {
    received: u64,
    lost: u64,
    last: Option<(u64, Arrivals)>,
}

impl Counts {
    /// Counts a sample and those between it and the last one of the same sender.
    fn take(&mut self, sample: &AnySample) {
        let stamp = sample.stamp();
        match &mut self.last {
            Some((boot_id, arrivals)) if *boot_id == stamp.boot_id => {
                self.lost = self.lost.saturating_add_signed(arrivals.take(stamp.seq).lost());
            }
            last => *last = Some((stamp.boot_id, Arrivals::new(stamp.seq))),
        }
        self.received += 1;
    }
}

pub struct softtwin_field(FieldSample);

impl softtwin_reader {
    fn new(reader: AnyReader) -> Self {
        let wait = WakeSet::new([&reader as &dyn Wakeable]);
        Self { reader, wait, counts: Counts::default() }
    }

    /// The event source of a waiter.
    pub(crate) fn wakeable(&self) -> &AnyReader {
        &self.reader
    }

    /// The oldest or newest waiting sample; waits for one at most `timeout_ms`; below 0: no limit.
    fn next(&mut self, newest: bool, timeout_ms: i64) -> Result<AnySample, Failure> {
        let end = u64::try_from(timeout_ms).ok().map(|ms| Instant::now() + Duration::from_millis(ms));
        loop {
            let found = if newest { self.reader.newest() } else { self.reader.next() };
            if let Some(found) = found? {
                self.counts.take(&found);
                return Ok(found);
            }
            let left =
                end.map_or(Duration::from_secs(3600), |end| end.saturating_duration_since(Instant::now()));
            if left.is_zero() {
                return Err(Failure::Timeout);
            }
            self.wait.wait(left)?;
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

/// # Safety
/// `bus` is live, strings are zero-terminated (`node_set` may be null), `out` points to memory for a pointer.
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
        let (bus, topic) = unsafe { (handle(bus)?, topic_of(name_, kind, node_set)?) };
        let reader = AnyReader::open(&bus.bus, &topic)?;
        // SAFETY: by the caller's promise.
        unsafe { write_handle(out, softtwin_reader::new(reader)) }
    })
}

/// # Safety
/// As `softtwin_reader_open`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_reader_attach(
    bus: *mut softtwin_bus,
    name_: *const c_char,
    kind: *const c_char,
    node_set: *const c_char,
    wakes: c_int,
    out: *mut *mut softtwin_reader,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let (bus, topic) = unsafe { (handle(bus)?, topic_of(name_, kind, node_set)?) };
        let waking = if wakes == 0 { Waking::Never } else { Waking::ByEvent };
        let reader = AnyReader::attach_as(&bus.bus, &topic, waking)?;
        // SAFETY: by the caller's promise.
        unsafe { write_handle(out, softtwin_reader::new(reader)) }
    })
}

/// The topic of a name, a kind and a node set or null.
///
/// # Safety
/// Strings are null or zero-terminated.
unsafe fn topic_of(name_: *const c_char, kind: *const c_char, set: *const c_char) -> Result<Topic, Failure> {
    // SAFETY: passed on.
    let (owner, kind, set) = unsafe { (name(name_)?, name(kind)?, text(set)?) };
    match set {
        Some(set) => Ok(Topic::field(owner, Some(set))?),
        None => topic(owner, kind),
    }
}

/// # Safety
/// `reader` is live and used by the thread that opened it; `received` and `lost` point to writable memory.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_reader_counts(
    reader: *mut softtwin_reader,
    received: *mut u64,
    lost: *mut u64,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let counts = &unsafe { handle(reader) }?.counts;
        // SAFETY: by the caller's promise.
        unsafe { put(received, counts.received).and_then(|()| put(lost, counts.lost)) }
    })
}

/// # Safety
/// `reader` is live and used by the thread that opened it, `payload` points to `size` writable bytes.
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
                "a {} of {} bytes was received, the buffer is for another payload",
                found.view().layout.name,
                bytes.len()
            )));
        }
        // SAFETY: `payload` has room for `size` bytes by the caller's promise; our own sample does not overlap with it.
        unsafe { std::ptr::copy_nonoverlapping(bytes.as_ptr(), payload.cast(), size) };
        Ok(())
    })
}

/// # Safety
/// `reader` is live and used by the thread that opened it, `out` points to memory for a pointer.
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
            AnySample::Field(field) => unsafe { give_field(out, field) },
            _ => Err(argument("this reader's topic has no fields")),
        }
    })
}

thread_local! {
    /// Memory of released handles of this thread: a loop does not allocate for its fields.
    #[expect(clippy::vec_box, reason = "the caller holds a handle's address while others are released")]
    static FREE: RefCell<Vec<Box<MaybeUninit<softtwin_field>>>> = const { RefCell::new(Vec::new()) };
}
/// Released handles that are kept.
const MAX_FREE: usize = 64;

/// # Safety
/// `out` is null or points to writable memory for a pointer.
unsafe fn give_field(out: *mut *mut softtwin_field, field: FieldSample) -> Result<(), Failure> {
    if out.is_null() {
        return Err(argument("the place for the result is null"));
    }
    let mut place = FREE.with_borrow_mut(Vec::pop).unwrap_or_else(Box::new_uninit);
    place.write(softtwin_field(field));
    // SAFETY: not null, and writable by the caller's promise; the place is initialised.
    unsafe { out.write(Box::into_raw(place).cast()) };
    Ok(())
}

/// # Safety
/// `reader` is null or came from `softtwin_reader_open` and is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_reader_close(reader: *mut softtwin_reader) {
    // SAFETY: by the caller's promise.
    unsafe { take(reader) }
}

/// # Safety
/// `field` is null or live.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_field_get_header(field: *const softtwin_field) -> *const FieldHeader {
    // SAFETY: null or live by the caller's promise.
    unsafe { field.as_ref() }.map_or(std::ptr::null(), |field| std::ptr::from_ref(field.0.header()))
}

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

/// # Safety
/// `field` is null or came from `softtwin_reader_read_field` and is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_field_release(field: *mut softtwin_field) {
    if field.is_null() {
        return;
    }
    // SAFETY: by the caller's promise it came out of `Box::into_raw` in `give_field` and is given back once.
    let mut place = unsafe { Box::from_raw(field.cast::<MaybeUninit<softtwin_field>>()) };
    // SAFETY: `give_field` initialised it.
    unsafe { place.assume_init_drop() };
    FREE.with_borrow_mut(|free| {
        if free.len() < MAX_FREE {
            free.push(place);
        }
    });
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
