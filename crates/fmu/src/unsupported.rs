//! Unsupported functions of FMI 3.0: they log their name and return fmi3Error.

use crate::ffi::{Handle, LogMessage, Status, call};
use std::ffi::{c_char, c_void};

/// Defines them with the types of FMI's header, one per line.
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
