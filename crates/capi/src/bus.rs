//! Membership in a domain, and what its twins call their models' regimes.

use crate::border::{Failure, argument, call, give, handle, put_text, take, text};
use crate::status::softtwin_status;
use std::ffi::c_char;
use wire::layout::{hex, regime};
use wire::{Bus, Domain, KnownRegimes};

/// A program's membership in a shared-memory domain.
pub struct softtwin_bus {
    pub(crate) bus: Bus,
    regimes: KnownRegimes,
}

/// Joins a domain. `domain` and `root` may be null: then `$SOFTTWIN_DOMAIN` and `$SOFTTWIN_ROOT` count, or iceoryx2's own.
///
/// # Safety
/// Texts are null or zero-terminated; `out` points to memory for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_bus_open(
    domain: *const c_char,
    root: *const c_char,
    out: *mut *mut softtwin_bus,
) -> softtwin_status {
    call(|| {
        let mut wanted = Domain::from_env();
        // SAFETY: by the caller's promise.
        if let Some(name) = unsafe { text(domain) }? {
            wanted.prefix = Domain::named(name).prefix;
        }
        // SAFETY: by the caller's promise.
        if let Some(root) = unsafe { text(root) }? {
            wanted.root = Some(root.to_owned());
        }
        let bus = Bus::open(&wanted)?;
        // SAFETY: by the caller's promise.
        unsafe { give(out, softtwin_bus { regimes: KnownRegimes::new(&bus), bus }) }
    })
}

/// Leaves the domain; readers and writers that were made from it go on.
///
/// # Safety
/// `bus` is null or came from `softtwin_bus_open` and is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_bus_close(bus: *mut softtwin_bus) {
    // SAFETY: by the caller's promise.
    unsafe { take(bus) }
}

/// What `regime` of a state, a field or an answer stands for, as a text: `free`, `contact`, or the name that the model of this hash
/// (16 bytes, `model_hash` of the same sample) has for it. `SOFTTWIN_ABSENT`: the name is the model's own and no running twin has told
/// it; the text is then `regime 3`. Each model is looked up once, and once a second as long as nobody tells its names.
///
/// # Safety
/// `bus` is live and used by its own thread, `model_hash` points to 16 bytes, `name` to `size` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_regime_name(
    bus: *mut softtwin_bus,
    model_hash: *const u8,
    regime: u32,
    name: *mut c_char,
    size: usize,
) -> softtwin_status {
    call(|| {
        // SAFETY: null, or 16 bytes without an alignment by the caller's promise; the handle as promised.
        let (bus, hash) = unsafe { (handle(bus)?, model_hash.cast::<[u8; 16]>().as_ref()) };
        let hash = hash.ok_or_else(|| argument("the model's hash is null"))?;
        let own = bus.regimes.name(hash, regime);
        // SAFETY: by the caller's promise.
        unsafe { put_text(name, size, own.unwrap_or(regime::as_str(regime))) }?;
        match own {
            None if regime >= regime::NAMED1 => Err(Failure::Own(
                softtwin_status::SOFTTWIN_ABSENT,
                format!(
                    "no running twin of this domain tells the names of the regimes of model {}",
                    hex(hash)
                ),
            )),
            _ => Ok(()),
        }
    })
}
