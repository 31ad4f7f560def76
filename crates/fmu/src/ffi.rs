//! FFI boundary: the supported functions of FMI 3.0. Strings and numbers in, a status out; panics are caught.

use crate::instance::{Instance, Now};
use std::ffi::{CStr, CString, c_char, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// Returned values of fmi3Status.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    Ok = 0,
    Error = 3,
    Fatal = 4,
}

/// fmi3LogMessageCallback.
pub type LogMessage = Option<
    unsafe extern "C" fn(*mut c_void, status: Status, category: *const c_char, message: *const c_char),
>;

/// Target of fmi3Instance.
pub struct Handle {
    instance: Instance,
    log: Log,
}

struct Log {
    message: LogMessage,
    environment: *mut c_void,
}

impl Log {
    /// Sends the reason of a failed call to the importer.
    fn say(&self, status: Status, text: &str) -> Status {
        let text = CString::new(text.replace('\0', " ")).unwrap_or_default();
        if let Some(message) = self.message {
            // SAFETY: the importer's function with its own environment; both strings live across the call.
            unsafe { message(self.environment, status, c"logStatusError".as_ptr(), text.as_ptr()) };
        }
        status
    }
}

/// Runs a call on an instance; a failure is logged and becomes fmi3Error, a panic fmi3Fatal.
///
/// # Safety
/// `handle` is null or came from an instantiation, was not freed, and is used by one thread.
pub(crate) unsafe fn call(
    handle: *mut Handle,
    body: impl FnOnce(&mut Instance) -> Result<(), String>,
) -> Status {
    // SAFETY: by the caller's promise.
    let Some(handle) = (unsafe { handle.as_mut() }) else { return Status::Error };
    match catch_unwind(AssertUnwindSafe(|| body(&mut handle.instance))) {
        Ok(Ok(())) => Status::Ok,
        Ok(Err(text)) => handle.log.say(Status::Error, &text),
        Err(_) => handle.log.say(Status::Fatal, "softtwin failed inside; please report what you did"),
    }
}

/// String from the importer.
///
/// # Safety
/// `text` is null or a zero-terminated string that lives across the use of the result.
unsafe fn text<'a>(text: *const c_char, what: &str) -> Result<&'a str, String> {
    if text.is_null() {
        return Err(format!("the {what} is null"));
    }
    // SAFETY: not null, and zero-terminated and alive by the caller's promise.
    unsafe { CStr::from_ptr(text) }.to_str().map_err(|_| format!("the {what} is not UTF-8"))
}

/// Creates an instance; null, with a reason in the log, on errors.
///
/// # Safety
/// `token` and `resources` are null or zero-terminated; `log` is the importer's.
unsafe fn instantiate(
    token: *const c_char,
    resources: *const c_char,
    is_exchange: bool,
    log: Log,
) -> *mut Handle {
    let open = || {
        // SAFETY: by the caller's promise.
        let (token, resources) =
            unsafe { (text(token, "token")?, text(resources, "path of the resources")?) };
        let instance = Instance::open(Path::new(resources), token)?;
        if is_exchange && instance.has_memory() {
            return Err(String::from(
                "expected co-simulation of a model with memory or inertia, found model exchange",
            ));
        }
        Ok(instance)
    };
    match catch_unwind(AssertUnwindSafe(open)) {
        Ok(Ok(instance)) => Box::into_raw(Box::new(Handle { instance, log })),
        Ok(Err(text)) => {
            log.say(Status::Error, &text);
            std::ptr::null_mut()
        }
        Err(_) => std::ptr::null_mut(),
    }
}

/// Version of FMI.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3GetVersion() -> *const c_char {
    c"3.0".as_ptr()
}

/// Has no effect: errors are always logged, and nothing else is.
///
/// # Safety
/// As specified by FMI.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SetDebugLogging(
    handle: *mut Handle,
    _on: bool,
    _count: usize,
    _categories: *const *const c_char,
) -> Status {
    // SAFETY: by the importer's promise.
    unsafe { call(handle, |_| Ok(())) }
}

/// Creates an instance for model exchange; it has no continuous states and no events.
///
/// # Safety
/// As specified by FMI.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3InstantiateModelExchange(
    _name: *const c_char,
    token: *const c_char,
    resources: *const c_char,
    _visible: bool,
    _logging: bool,
    environment: *mut c_void,
    message: LogMessage,
) -> *mut Handle {
    // SAFETY: by the importer's promise.
    unsafe { instantiate(token, resources, true, Log { message, environment }) }
}

/// Creates an instance for co-simulation.
///
/// # Safety
/// As specified by FMI.
#[unsafe(no_mangle)]
#[allow(clippy::too_many_arguments)] // FMI's signature
pub unsafe extern "C" fn fmi3InstantiateCoSimulation(
    _name: *const c_char,
    token: *const c_char,
    resources: *const c_char,
    _visible: bool,
    _logging: bool,
    _event_mode: bool,
    _early_return: bool,
    _required: *const u32,
    _required_count: usize,
    environment: *mut c_void,
    message: LogMessage,
    _intermediate_update: *const c_void,
) -> *mut Handle {
    // SAFETY: by the importer's promise.
    unsafe { instantiate(token, resources, false, Log { message, environment }) }
}

/// Ends an instance.
///
/// # Safety
/// As specified by FMI.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3FreeInstance(handle: *mut Handle) {
    if !handle.is_null() {
        // SAFETY: it came out of `Box::into_raw` in `instantiate` and is given back once, by the importer's promise.
        drop(unsafe { Box::from_raw(handle) });
    }
}

/// Begins the initialization at a time, s.
///
/// # Safety
/// As specified by FMI.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3EnterInitializationMode(
    handle: *mut Handle,
    _tolerance_defined: bool,
    _tolerance: f64,
    start_s: f64,
    _stop_defined: bool,
    _stop_s: f64,
) -> Status {
    // SAFETY: by the importer's promise.
    unsafe { call(handle, |instance| instance.move_to(start_s)) }
}

/// Changes of mode, without effect for a model without states.
macro_rules! modes {
    ($($name:ident),*) => { $(
        /// Change of mode, without effect for a model without states.
        ///
        /// # Safety
        /// As specified by FMI.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $name(handle: *mut Handle) -> Status {
            // SAFETY: by the importer's promise.
            unsafe { call(handle, |_| Ok(())) }
        }
    )* };
}
modes!(
    fmi3ExitInitializationMode,
    fmi3EnterEventMode,
    fmi3EnterStepMode,
    fmi3EnterContinuousTimeMode,
    fmi3EnterConfigurationMode,
    fmi3ExitConfigurationMode,
    fmi3EvaluateDiscreteStates,
    fmi3Terminate
);

/// Restores the state after instantiation.
///
/// # Safety
/// As specified by FMI.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3Reset(handle: *mut Handle) -> Status {
    // SAFETY: by the importer's promise.
    unsafe { call(handle, |instance| instance.reset()) }
}

/// Sets the time, s.
///
/// # Safety
/// As specified by FMI.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SetTime(handle: *mut Handle, time_s: f64) -> Status {
    // SAFETY: by the importer's promise.
    unsafe { call(handle, |instance| instance.move_to(time_s)) }
}

/// Reads or writes `count` values at value references.
///
/// # Safety
/// `references` points to `count` numbers, `values` to `value_count` writable ones (both may be null when 0).
unsafe fn each<T>(
    (references, count): (*const u32, usize),
    (values, value_count): (*mut T, usize),
    mut one: impl FnMut(u32, &mut T) -> Result<(), String>,
) -> Result<(), String> {
    if count != value_count {
        return Err(format!("expected one value for each of {count} references, found {value_count}"));
    }
    if count > 0 && (references.is_null() || values.is_null()) {
        return Err("the references or the values are null".into());
    }
    for at in 0..count {
        // SAFETY: both are not null and have `count` entries by the caller's promise.
        let (reference, value) = unsafe { (*references.add(at), &mut *values.add(at)) };
        one(reference, value)?;
    }
    Ok(())
}

/// Reads inputs and outputs.
///
/// # Safety
/// As specified by FMI.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetFloat64(
    handle: *mut Handle,
    references: *const u32,
    count: usize,
    values: *mut f64,
    value_count: usize,
) -> Status {
    // SAFETY: by the importer's promise.
    unsafe {
        call(handle, |instance| {
            let get = |reference, value: &mut f64| instance.float(reference).map(|found| *value = found);
            each((references, count), (values, value_count), get)
        })
    }
}

/// Sets inputs. NaN is refused with fmi3Error, and the old value is kept.
///
/// # Safety
/// As specified by FMI.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SetFloat64(
    handle: *mut Handle,
    references: *const u32,
    count: usize,
    values: *const f64,
    value_count: usize,
) -> Status {
    // SAFETY: by the importer's promise; the values are only read.
    unsafe {
        call(handle, |instance| {
            each((references, count), (values.cast_mut().cast::<Given>(), value_count), |reference, value| {
                instance.set(reference, value.0)
            })
        })
    }
}

/// Read-only value.
#[repr(transparent)]
struct Given(f64);

/// Reads domain status and regime.
///
/// # Safety
/// As specified by FMI.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetInt32(
    handle: *mut Handle,
    references: *const u32,
    count: usize,
    values: *mut i32,
    value_count: usize,
) -> Status {
    // SAFETY: by the importer's promise.
    unsafe {
        call(handle, |instance| {
            let get = |reference, value: &mut i32| instance.integer(reference).map(|found| *value = found);
            each((references, count), (values, value_count), get)
        })
    }
}

/// Writes a value unless `place` is null.
///
/// # Safety
/// `place` is null or writable.
unsafe fn put<T>(place: *mut T, value: T) {
    if !place.is_null() {
        // SAFETY: not null, and writable by the caller's promise.
        unsafe { place.write(value) };
    }
}

/// Reports neither discrete states nor events.
///
/// # Safety
/// As specified by FMI.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3UpdateDiscreteStates(
    handle: *mut Handle,
    needs_update: *mut bool,
    terminate: *mut bool,
    nominals_changed: *mut bool,
    values_changed: *mut bool,
    next_event_defined: *mut bool,
    _next_event_s: *mut f64,
) -> Status {
    // SAFETY: by the importer's promise.
    unsafe {
        for place in [needs_update, terminate, nominals_changed, values_changed, next_event_defined] {
            put(place, false);
        }
        call(handle, |_| Ok(()))
    }
}

/// Reports neither an event nor an end.
///
/// # Safety
/// As specified by FMI.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3CompletedIntegratorStep(
    handle: *mut Handle,
    _no_set_prior: bool,
    enter_event_mode: *mut bool,
    terminate: *mut bool,
) -> Status {
    // SAFETY: by the importer's promise.
    unsafe {
        put(enter_event_mode, false);
        put(terminate, false);
        call(handle, |_| Ok(()))
    }
}

/// Number of continuous states: 0.
///
/// # Safety
/// As specified by FMI.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetNumberOfContinuousStates(handle: *mut Handle, count: *mut usize) -> Status {
    // SAFETY: by the importer's promise.
    unsafe {
        put(count, 0);
        call(handle, |_| Ok(()))
    }
}

/// Number of event indicators: 0.
///
/// # Safety
/// As specified by FMI.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetNumberOfEventIndicators(handle: *mut Handle, count: *mut usize) -> Status {
    // SAFETY: by the importer's promise.
    unsafe {
        put(count, 0);
        call(handle, |_| Ok(()))
    }
}

/// Functions with arrays of states and events, which are empty.
macro_rules! empty_arrays {
    ($($name:ident($type:ty)),*) => { $(
        /// Array that is empty for a model without states and events.
        ///
        /// # Safety
        /// As specified by FMI.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $name(handle: *mut Handle, _values: $type, count: usize) -> Status {
            let expected = if count == 0 { Ok(()) } else { Err(format!("expected no values, found {count}")) };
            // SAFETY: by the importer's promise.
            unsafe { call(handle, |_| expected) }
        }
    )* };
}
empty_arrays!(
    fmi3GetContinuousStates(*mut f64),
    fmi3SetContinuousStates(*const f64),
    fmi3GetContinuousStateDerivatives(*mut f64),
    fmi3GetNominalsOfContinuousStates(*mut f64),
    fmi3GetEventIndicators(*mut f64)
);

/// Makes a step of constant inputs, s. Outputs of a static model follow from the inputs without delay.
///
/// # Safety
/// As specified by FMI.
#[unsafe(no_mangle)]
#[allow(clippy::too_many_arguments)] // FMI's signature
pub unsafe extern "C" fn fmi3DoStep(
    handle: *mut Handle,
    current_s: f64,
    step_s: f64,
    _no_set_prior: bool,
    event_needed: *mut bool,
    terminate: *mut bool,
    early_return: *mut bool,
    last_s: *mut f64,
) -> Status {
    // SAFETY: by the importer's promise.
    unsafe {
        for place in [event_needed, terminate, early_return] {
            put(place, false);
        }
        call(handle, |instance| {
            instance.step(current_s, step_s)?;
            put(last_s, current_s + step_s);
            Ok(())
        })
    }
}

/// Saves the state: inputs, time, memory and motion. A null state is created, another one is overwritten.
///
/// # Safety
/// As specified by FMI.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetFMUState(handle: *mut Handle, state: *mut *mut Now) -> Status {
    // SAFETY: by the importer's promise.
    unsafe {
        call(handle, |instance| {
            let place = state.as_mut().ok_or("the place for the state is null")?;
            match place.as_mut() {
                Some(saved) => *saved = instance.saved(),
                None => *place = Box::into_raw(Box::new(instance.saved())),
            }
            Ok(())
        })
    }
}

/// Returns to a saved state of the same instance.
///
/// # Safety
/// As specified by FMI.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SetFMUState(handle: *mut Handle, state: *mut Now) -> Status {
    // SAFETY: by the importer's promise.
    unsafe {
        call(handle, |instance| {
            instance.restore(state.as_ref().ok_or("the state is null")?);
            Ok(())
        })
    }
}

/// Frees a saved state; its place becomes null.
///
/// # Safety
/// As specified by FMI.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3FreeFMUState(handle: *mut Handle, state: *mut *mut Now) -> Status {
    // SAFETY: by the importer's promise; a state came out of `Box::into_raw` in `fmi3GetFMUState`.
    unsafe {
        call(handle, |_| {
            let place = state.as_mut().ok_or("the place of the state is null")?;
            let state = std::mem::replace(place, std::ptr::null_mut());
            if !state.is_null() {
                drop(Box::from_raw(state));
            }
            Ok(())
        })
    }
}
