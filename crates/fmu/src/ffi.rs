//! FFI boundary: the supported functions of FMI 3.0. Strings and numbers in, a status out; panics are caught.

use crate::instance::{Instance, InstanceState};
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

/// Calls `one` with the position and the value reference of each of `count` values at `values`.
///
/// # Safety
/// `references` points to `count` numbers; it may be null when 0.
unsafe fn each<T>(
    (references, count): (*const u32, usize),
    (values, value_count): (*const T, usize),
    mut one: impl FnMut(usize, u32) -> Result<(), String>,
) -> Result<(), String> {
    if count != value_count {
        return Err(format!("expected one value for each of {count} references, found {value_count}"));
    }
    if count > 0 && (references.is_null() || values.is_null()) {
        return Err("the references or the values are null".into());
    }
    for at in 0..count {
        // SAFETY: not null, and `count` entries by the caller's promise.
        one(at, unsafe { *references.add(at) })?;
    }
    Ok(())
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

/// Arrays of states and events are empty.
fn empty(count: usize) -> Result<(), String> {
    if count == 0 { Ok(()) } else { Err(format!("expected no values, found {count}")) }
}

/// Defines functions of an instance: name, arguments behind the handle, what they do with the instance.
macro_rules! functions {
    ($($(#[doc = $doc:literal])+ $name:ident($($argument:tt: $type:ty),*) $body:expr;)+) => { $(
        $(#[doc = $doc])+
        ///
        /// # Safety
        /// As specified by FMI.
        #[unsafe(no_mangle)]
        #[allow(clippy::too_many_arguments)] // FMI's signatures
        pub unsafe extern "C" fn $name(handle: *mut Handle, $($argument: $type),*) -> Status {
            // SAFETY: by the importer's promise; values that are set are only read. A state came out of `Box::into_raw`
            // in `fmi3GetFMUState`.
            unsafe { call(handle, $body) }
        }
    )+ };
}

functions! {
    /// Has no effect: errors are always logged, and nothing else is.
    fmi3SetDebugLogging(_: bool, _: usize, _: *const *const c_char) |_| Ok(());
    /// Begins the initialization at a time, s.
    fmi3EnterInitializationMode(_: bool, _: f64, start_s: f64, _: bool, _: f64) |instance| instance.move_to(start_s);
    /// No effect: the model has no modes.
    fmi3ExitInitializationMode() |_| Ok(());
    /// No effect: the model has no modes.
    fmi3EnterEventMode() |_| Ok(());
    /// No effect: the model has no modes.
    fmi3EnterStepMode() |_| Ok(());
    /// No effect: the model has no modes.
    fmi3EnterContinuousTimeMode() |_| Ok(());
    /// No effect: the model has no modes.
    fmi3EnterConfigurationMode() |_| Ok(());
    /// No effect: the model has no modes.
    fmi3ExitConfigurationMode() |_| Ok(());
    /// No effect: the model has no discrete states.
    fmi3EvaluateDiscreteStates() |_| Ok(());
    /// No effect: the model has no modes.
    fmi3Terminate() |_| Ok(());
    /// Restores the state after instantiation.
    fmi3Reset() |instance| instance.reset();
    /// Sets the time, s.
    fmi3SetTime(time_s: f64) |instance| instance.move_to(time_s);
    /// Reads inputs and outputs.
    fmi3GetFloat64(references: *const u32, count: usize, values: *mut f64, value_count: usize) |instance| {
        let get = |at, reference| instance.float(reference).map(|found| put(values.add(at), found));
        each((references, count), (values, value_count), get)
    };
    /// Sets inputs. NaN is refused with fmi3Error, and the old value is kept.
    fmi3SetFloat64(references: *const u32, count: usize, values: *const f64, value_count: usize) |instance| {
        let set = |at, reference| instance.set(reference, *values.add(at));
        each((references, count), (values, value_count), set)
    };
    /// Reads domain status and regime.
    fmi3GetInt32(references: *const u32, count: usize, values: *mut i32, value_count: usize) |instance| {
        let get = |at, reference| instance.integer(reference).map(|found| put(values.add(at), found));
        each((references, count), (values, value_count), get)
    };
    /// Reports neither discrete states nor events.
    fmi3UpdateDiscreteStates(
        needs_update: *mut bool, terminate: *mut bool, nominals_changed: *mut bool, values_changed: *mut bool,
        next_event_defined: *mut bool, _: *mut f64
    ) |_| {
        for place in [needs_update, terminate, nominals_changed, values_changed, next_event_defined] {
            put(place, false);
        }
        Ok(())
    };
    /// Reports neither an event nor an end.
    fmi3CompletedIntegratorStep(_: bool, enter_event_mode: *mut bool, terminate: *mut bool) |_| {
        put(enter_event_mode, false);
        put(terminate, false);
        Ok(())
    };
    /// Number of continuous states: 0.
    fmi3GetNumberOfContinuousStates(count: *mut usize) |_| {
        put(count, 0);
        Ok(())
    };
    /// Number of event indicators: 0.
    fmi3GetNumberOfEventIndicators(count: *mut usize) |_| {
        put(count, 0);
        Ok(())
    };
    /// Empty array: the model has no continuous states.
    fmi3GetContinuousStates(_: *mut f64, count: usize) |_| empty(count);
    /// Empty array: the model has no continuous states.
    fmi3SetContinuousStates(_: *const f64, count: usize) |_| empty(count);
    /// Empty array: the model has no continuous states.
    fmi3GetContinuousStateDerivatives(_: *mut f64, count: usize) |_| empty(count);
    /// Empty array: the model has no continuous states.
    fmi3GetNominalsOfContinuousStates(_: *mut f64, count: usize) |_| empty(count);
    /// Empty array: the model has no events.
    fmi3GetEventIndicators(_: *mut f64, count: usize) |_| empty(count);
    /// Makes a step of constant inputs, s. Outputs of a static model follow from the inputs without delay.
    fmi3DoStep(
        current_s: f64, step_s: f64, _: bool, event_needed: *mut bool, terminate: *mut bool, early_return: *mut bool,
        last_s: *mut f64
    ) |instance| {
        for place in [event_needed, terminate, early_return] {
            put(place, false);
        }
        instance.step(current_s, step_s)?;
        put(last_s, current_s + step_s);
        Ok(())
    };
    /// Saves the state: inputs, time, memory and motion. A null state is created, another one is overwritten.
    fmi3GetFMUState(state: *mut *mut InstanceState) |instance| {
        let place = state.as_mut().ok_or("the place for the state is null")?;
        match place.as_mut() {
            Some(saved) => *saved = instance.saved(),
            None => *place = Box::into_raw(Box::new(instance.saved())),
        }
        Ok(())
    };
    /// Returns to a saved state of the same instance.
    fmi3SetFMUState(state: *mut InstanceState) |instance| {
        instance.restore(state.as_ref().ok_or("the state is null")?);
        Ok(())
    };
    /// Frees a saved state; its place becomes null.
    fmi3FreeFMUState(state: *mut *mut InstanceState) |_| {
        let place = state.as_mut().ok_or("the place of the state is null")?;
        let state = std::mem::replace(place, std::ptr::null_mut());
        if !state.is_null() {
            drop(Box::from_raw(state));
        }
        Ok(())
    };
}

/// Defines the functions that are not supported: they log their name and return fmi3Error. With the types of FMI's header, one per line.
macro_rules! unsupported {
    ($($name:ident($($type:ty),*);)*) => { $(
        /// Not supported by this model.
        ///
        /// # Safety
        /// As specified by FMI.
        #[unsafe(no_mangle)]
        #[allow(clippy::too_many_arguments)] // FMI's signature
        pub unsafe extern "C" fn $name(handle: *mut Handle, $(_: $type),*) -> Status {
            // SAFETY: by the importer's promise.
            unsafe { call(handle, |_| Err(concat!(stringify!($name), " is not supported by this FMU").into())) }
        }
    )* };
}

unsupported! {
    fmi3GetFloat32(*const u32, usize, *mut f32, usize);
    fmi3GetInt8(*const u32, usize, *mut i8, usize);
    fmi3GetUInt8(*const u32, usize, *mut u8, usize);
    fmi3GetInt16(*const u32, usize, *mut i16, usize);
    fmi3GetUInt16(*const u32, usize, *mut u16, usize);
    fmi3GetUInt32(*const u32, usize, *mut u32, usize);
    fmi3GetInt64(*const u32, usize, *mut i64, usize);
    fmi3GetUInt64(*const u32, usize, *mut u64, usize);
    fmi3GetBoolean(*const u32, usize, *mut bool, usize);
    fmi3GetString(*const u32, usize, *mut *const c_char, usize);
    fmi3GetBinary(*const u32, usize, *mut usize, *mut *const u8, usize);
    fmi3GetClock(*const u32, usize, *mut bool);
    fmi3SetFloat32(*const u32, usize, *const f32, usize);
    fmi3SetInt8(*const u32, usize, *const i8, usize);
    fmi3SetUInt8(*const u32, usize, *const u8, usize);
    fmi3SetInt16(*const u32, usize, *const i16, usize);
    fmi3SetUInt16(*const u32, usize, *const u16, usize);
    fmi3SetInt32(*const u32, usize, *const i32, usize);
    fmi3SetUInt32(*const u32, usize, *const u32, usize);
    fmi3SetInt64(*const u32, usize, *const i64, usize);
    fmi3SetUInt64(*const u32, usize, *const u64, usize);
    fmi3SetBoolean(*const u32, usize, *const bool, usize);
    fmi3SetString(*const u32, usize, *const *const c_char, usize);
    fmi3SetBinary(*const u32, usize, *const usize, *const *const u8, usize);
    fmi3SetClock(*const u32, usize, *const bool);
    fmi3GetNumberOfVariableDependencies(u32, *mut usize);
    fmi3GetVariableDependencies(u32, *mut usize, *mut u32, *mut usize, *mut i32, usize);
    fmi3SerializedFMUStateSize(*mut c_void, *mut usize);
    fmi3SerializeFMUState(*mut c_void, *mut u8, usize);
    fmi3DeserializeFMUState(*const u8, usize, *mut *mut c_void);
    fmi3GetDirectionalDerivative(*const u32, usize, *const u32, usize, *const f64, usize, *mut f64, usize);
    fmi3GetAdjointDerivative(*const u32, usize, *const u32, usize, *const f64, usize, *mut f64, usize);
    fmi3GetIntervalDecimal(*const u32, usize, *mut f64, *mut i32);
    fmi3GetIntervalFraction(*const u32, usize, *mut u64, *mut u64, *mut i32);
    fmi3GetShiftDecimal(*const u32, usize, *mut f64);
    fmi3GetShiftFraction(*const u32, usize, *mut u64, *mut u64);
    fmi3SetIntervalDecimal(*const u32, usize, *const f64);
    fmi3SetIntervalFraction(*const u32, usize, *const u64, *const u64);
    fmi3SetShiftDecimal(*const u32, usize, *const f64);
    fmi3SetShiftFraction(*const u32, usize, *const u64, *const u64);
    fmi3GetOutputDerivatives(*const u32, usize, *const i32, *mut f64, usize);
    fmi3ActivateModelPartition(u32, f64);
}

/// Returns null: scheduled execution needs clocks, which the model does not have.
///
/// # Safety
/// As specified by FMI.
#[unsafe(no_mangle)]
#[allow(clippy::too_many_arguments)] // FMI's signature
pub unsafe extern "C" fn fmi3InstantiateScheduledExecution(
    _name: *const c_char,
    _token: *const c_char,
    _resources: *const c_char,
    _visible: bool,
    _logging: bool,
    _environment: *mut c_void,
    _message: LogMessage,
    _clock_update: *const c_void,
    _lock_preemption: *const c_void,
    _unlock_preemption: *const c_void,
) -> *mut Handle {
    std::ptr::null_mut()
}
