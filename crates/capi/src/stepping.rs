//! The controller in a loop of the caller: from a model and a scene's file, stepped by readings with their times, without a bus.

use crate::ffi::{argument, call, handle, name, put, shared, softtwin_status, take, text, write_handle};
use crate::model::softtwin_model;
use control::ahead::TargetSeries;
use control::held::Stepping;
use control::law::{Cycle, Limited, Reading, Target};
use control::monitor::Fault;
use rom::inputs::MAX_INPUTS;
use std::ffi::c_char;
use std::path::Path;

/// Largest file that is read as a scene, bytes.
const MAX_SCENE_BYTES: u64 = 1 << 20;
/// Most targets of a series: a minute at 1 kHz is more than any horizon.
const MAX_TARGETS: usize = 60_000;
/// Faults by their number, less one.
const FAULTS: [Fault; 4] =
    [Fault::NoResponse, Fault::OppositeSign, Fault::Unexplained, Fault::MeasurementLost];

pub struct softtwin_control {
    stepping: Stepping,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct softtwin_control_reading {
    pressure_mpa: f64,
    gap_mm: f64,
    measured: f64,
    written_mpa: f64,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct softtwin_control_cycle {
    setpoint_mpa: f64,
    target: f64,
    reference_mpa: f64,
    followed: f64,
    correction_mpa: f64,
    bias_mpa: f64,
    limited: u32,
    fault: u32,
}

/// The Python client's structure has the same size.
const _: () = assert!(size_of::<softtwin_control_cycle>() == 56);

impl From<softtwin_control_reading> for Reading {
    fn from(reading: softtwin_control_reading) -> Self {
        let softtwin_control_reading { pressure_mpa, gap_mm, measured, written_mpa } = reading;
        Self { pressure_mpa, gap_mm, measured, written_mpa }
    }
}

impl From<Cycle> for softtwin_control_cycle {
    fn from(cycle: Cycle) -> Self {
        let Limited { by_force, by_range, by_rate, by_correction, by_valve, by_supply } = cycle.limited;
        let bits = [by_force, by_range, by_rate, by_correction, by_valve, by_supply];
        let number = |fault| FAULTS.iter().position(|known| *known == fault).map_or(0, |at| at as u32 + 1);
        Self {
            setpoint_mpa: cycle.pressure_mpa,
            target: cycle.target,
            reference_mpa: cycle.reference_mpa,
            followed: cycle.followed,
            correction_mpa: cycle.correction_mpa,
            bias_mpa: cycle.bias_mpa,
            limited: bits.iter().enumerate().map(|(index, bit)| u32::from(*bit) << index).sum(),
            fault: cycle.fault.map_or(0, number),
        }
    }
}

/// # Safety
/// `model` is live, strings are zero-terminated or, where it says so, null, `out` points to memory for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_control_open(
    model: *const softtwin_model,
    scene: *const c_char,
    actuator: *const c_char,
    held: *const c_char,
    out: *mut *mut softtwin_control,
) -> softtwin_status {
    call(|| {
        // SAFETY: null or live by the caller's promise.
        let model = unsafe { shared(model, "the model") }?.model();
        // SAFETY: by the caller's promise.
        let (scene, actuator, held) = unsafe { (text(scene)?, text(actuator)?, name(held)?) };
        let read = |path: &str| {
            let refused = |error: &dyn std::fmt::Display| argument(&format!("{path}: {error}"));
            let found = Path::new(path).metadata().map_err(|error| refused(&error))?;
            if !found.is_file() || found.len() > MAX_SCENE_BYTES {
                return Err(refused(&format!("expected a file of at most {MAX_SCENE_BYTES} bytes")));
            }
            std::fs::read_to_string(path).map_err(|error| refused(&error))
        };
        let scene = scene.map(read).transpose()?;
        let stepping = Stepping::open(model, scene.as_deref(), actuator, held);
        let stepping = stepping.map_err(|error| argument(&error.to_string()))?;
        // SAFETY: by the caller's promise.
        unsafe { write_handle(out, softtwin_control { stepping }) }
    })
}

/// # Safety
/// `control` is live and used by one thread; `inputs` points to `count` numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_control_inputs(
    control: *mut softtwin_control,
    inputs: *const f64,
    count: usize,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let control = unsafe { handle(control) }?;
        if inputs.is_null() || count > MAX_INPUTS {
            return Err(argument(&format!("expected at most {MAX_INPUTS} inputs, found {count}")));
        }
        // SAFETY: not null, and `count` numbers by the caller's promise.
        let inputs = unsafe { std::slice::from_raw_parts(inputs, count) };
        control.stepping.set_inputs(inputs).map_err(|error| argument(&error.to_string()))
    })
}

/// # Safety
/// `control` is live and used by one thread, `reading` and `out` are null or point to structures.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_control_step(
    control: *mut softtwin_control,
    t_ns: u64,
    target: f64,
    rate_per_s: f64,
    reading: *const softtwin_control_reading,
    out: *mut softtwin_control_cycle,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let (control, reading) = unsafe { (handle(control)?, reading.as_ref()) };
        let reading = *reading.ok_or_else(|| argument("the reading is null"))?;
        if out.is_null() {
            return Err(argument("the place for the cycle is null"));
        }
        let target = Target { value: target, rate: rate_per_s };
        let cycle = control.stepping.step(t_ns, target, reading.into());
        // SAFETY: by the caller's promise.
        unsafe { put(out, cycle.map_err(|error| argument(&error.to_string()))?.into()) }
    })
}

/// # Safety
/// `control` is live and used by one thread, `targets` points to `count` numbers, `reading` and `out` are null or point to structures.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_control_step_ahead(
    control: *mut softtwin_control,
    t_ns: u64,
    targets: *const f64,
    count: usize,
    interval_s: f64,
    reading: *const softtwin_control_reading,
    out: *mut softtwin_control_cycle,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let (control, reading) = unsafe { (handle(control)?, reading.as_ref()) };
        let reading = *reading.ok_or_else(|| argument("the reading is null"))?;
        if out.is_null() || targets.is_null() || count > MAX_TARGETS {
            let expected = format!("expected a place for the cycle and at most {MAX_TARGETS} targets");
            return Err(argument(&format!("{expected}, found {count}")));
        }
        // SAFETY: not null, and `count` numbers by the caller's promise.
        let values = unsafe { std::slice::from_raw_parts(targets, count) };
        let cycle = control.stepping.step_ahead(t_ns, TargetSeries { values, interval_s }, reading.into());
        // SAFETY: by the caller's promise.
        unsafe { put(out, cycle.map_err(|error| argument(&error.to_string()))?.into()) }
    })
}

/// # Safety
/// `control` is live and used by one thread, `reading` is null or points to a structure.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_control_start(
    control: *mut softtwin_control,
    reading: *const softtwin_control_reading,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let (control, reading) = unsafe { (handle(control)?, reading.as_ref()) };
        let reading = *reading.ok_or_else(|| argument("the reading is null"))?;
        if !reading.pressure_mpa.is_finite() || !reading.gap_mm.is_finite() {
            return Err(argument("expected a finite pressure_mpa and gap_mm to start from"));
        }
        control.stepping.controller_mut().start(reading.into());
        Ok(())
    })
}

/// # Safety
/// `control` is null or live.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_control_release(control: *mut softtwin_control) {
    // SAFETY: by the caller's promise.
    if let Some(control) = unsafe { control.as_mut() } {
        control.stepping.controller_mut().release();
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn softtwin_control_fault_name(fault: u32) -> *const c_char {
    let names = [c"none", c"no-response", c"opposite-sign", c"unexplained", c"measurement-lost"];
    names.get(fault as usize).unwrap_or(&c"none").as_ptr()
}

/// # Safety
/// `control` is null or came from `softtwin_control_open` and is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_control_close(control: *mut softtwin_control) {
    // SAFETY: by the caller's promise.
    unsafe { take(control) }
}
