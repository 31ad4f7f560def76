//! Writers: readings in place of a bridge, pressure commands, setpoints of a valve's owner, targets of its controller.

use crate::bus::softtwin_bus;
use crate::ffi::{argument, call, handle, name, softtwin_status, take, text, write_handle};
use crate::reader::topic;
use std::ffi::c_char;
use wire::layout::{PARAMETERS_MAX, TARGET_VALUES_MAX, pack_name, target_kind};
use wire::{
    Command, CommandWriter, SensorSample, SensorWriter, Setpoint, SetpointWriter, Target, TargetWriter,
    TopicKind, boot_id, now_ns,
};

/// Longest name of an owner or an input, bytes.
const NAME_BYTES: usize = 31;

pub struct softtwin_writer {
    port: Port,
    boot_id: u64,
    seq: u64,
}

enum Port {
    Sensor(SensorWriter),
    Command(CommandWriter),
    /// With the packed name of the owner.
    Setpoint(SetpointWriter, [u8; 32]),
    /// With the packed name of the owner.
    Target(TargetWriter, [u8; 32]),
}

/// Becomes the writer of a topic with an owner, or of its part for a cavity.
///
/// # Safety
/// As of the functions that pass their arguments on.
unsafe fn open_owned(
    bus: *mut softtwin_bus,
    [actuator, cavity, owner]: [*const c_char; 3],
    kind: &str,
    out: *mut *mut softtwin_writer,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let (bus, actuator, owner) = unsafe { (handle(bus)?, name(actuator)?, name(owner)?) };
        if !(1..=NAME_BYTES).contains(&owner.len()) || owner.contains(char::is_control) {
            return Err(argument(&format!(
                "expected an owner's name of 1 to {NAME_BYTES} bytes, found {owner:?}"
            )));
        }
        // SAFETY: by the caller's promise.
        let topic = match unsafe { text(cavity)? } {
            Some(cavity) => topic(actuator, kind)?.of_cavity(Some(cavity))?,
            None => topic(actuator, kind)?,
        };
        let port = match topic.kind() {
            TopicKind::Setpoint => {
                Port::Setpoint(SetpointWriter::create_named(&bus.bus, &topic, owner)?, pack_name(owner))
            }
            _ => Port::Target(TargetWriter::create_named(&bus.bus, &topic, owner)?, pack_name(owner)),
        };
        // SAFETY: by the caller's promise.
        unsafe { write_handle(out, softtwin_writer { port, boot_id: boot_id(), seq: 0 }) }
    })
}

/// # Safety
/// `bus` is live, strings are zero-terminated, `out` points to memory for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_writer_open(
    bus: *mut softtwin_bus,
    name_: *const c_char,
    kind: *const c_char,
    out: *mut *mut softtwin_writer,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let (bus, owner, kind) = unsafe { (handle(bus)?, name(name_)?, name(kind)?) };
        let topic = topic(owner, kind)?;
        let port = match topic.kind() {
            TopicKind::Sensor => Port::Sensor(SensorWriter::create(&bus.bus, &topic)?),
            TopicKind::Command => Port::Command(CommandWriter::create(&bus.bus, &topic)?),
            TopicKind::Setpoint => {
                return Err(argument("setpoints have an owner; expected softtwin_writer_open_setpoint"));
            }
            TopicKind::Target => {
                return Err(argument("targets have an owner; expected softtwin_writer_open_target"));
            }
            _ => return Err(argument(&format!("{topic} is the twin's own; expected sensor or command"))),
        };
        // SAFETY: by the caller's promise.
        unsafe { write_handle(out, softtwin_writer { port, boot_id: boot_id(), seq: 0 }) }
    })
}

/// # Safety
/// `bus` is live, strings are zero-terminated, `cavity` is null or one of them, `out` points to memory for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_writer_open_setpoint(
    bus: *mut softtwin_bus,
    actuator: *const c_char,
    cavity: *const c_char,
    owner: *const c_char,
    out: *mut *mut softtwin_writer,
) -> softtwin_status {
    // SAFETY: the caller's promise is passed on.
    unsafe { open_owned(bus, [actuator, cavity, owner], "setpoint", out) }
}

/// # Safety
/// `writer` is live and used by the thread that opened it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_writer_send_setpoint(
    writer: *mut softtwin_writer,
    pressure_mpa: f64,
    valid_ms: u32,
    t_sensor_ns: u64,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let softtwin_writer { port: Port::Setpoint(port, owner), boot_id, seq } =
            (unsafe { handle(writer) })?
        else {
            return Err(argument("this writer is not one of setpoints"));
        };
        *seq += 1;
        let (boot_id, seq, t_publish_ns) = (*boot_id, *seq, now_ns());
        let valid_for_ns = u64::from(valid_ms) * 1_000_000;
        let stamped = Setpoint { boot_id, seq, t_sensor_ns, t_publish_ns, ..Setpoint::default() };
        Ok(port.publish(Setpoint { valid_for_ns, pressure_mpa, owner: *owner, ..stamped })?)
    })
}

/// # Safety
/// `bus` is live, strings are zero-terminated, `out` points to memory for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_writer_open_target(
    bus: *mut softtwin_bus,
    actuator: *const c_char,
    owner: *const c_char,
    out: *mut *mut softtwin_writer,
) -> softtwin_status {
    // SAFETY: the caller's promise is passed on.
    unsafe { open_owned(bus, [actuator, std::ptr::null(), owner], "target", out) }
}

/// # Safety
/// `writer` is live and used by the thread that opened it; `values` points to `count` numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_writer_send_target(
    writer: *mut softtwin_writer,
    kind: u32,
    values: *const f64,
    count: usize,
    rate_per_s: f64,
    interval_s: f64,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let softtwin_writer { port: Port::Target(port, owner), boot_id, seq } = (unsafe { handle(writer) })?
        else {
            return Err(argument("this writer is not one of targets"));
        };
        let most = if kind == target_kind::SERIES { TARGET_VALUES_MAX } else { 1 };
        if values.is_null() || !(1..=most).contains(&count) {
            return Err(argument(&format!("expected 1 to {most} values, found {count}")));
        }
        // SAFETY: not null, and `count` numbers by the caller's promise.
        let values = unsafe { std::slice::from_raw_parts(values, count) };
        if let Some(value) = values.iter().find(|value| !value.is_finite()) {
            return Err(argument(&format!("expected finite values, found {value}")));
        }
        let is_above = |value: f64| value > 0.0 && value.is_finite();
        let mut target = Target { target_kind: kind, value_count: count as u32, ..Target::default() };
        match kind {
            target_kind::STEP => {}
            target_kind::RAMP if is_above(rate_per_s) => target.rate_per_s = rate_per_s,
            target_kind::SERIES if is_above(interval_s) => target.interval_s = interval_s,
            _ => {
                return Err(argument(&format!(
                    "expected a step, a ramp with rate_per_s above 0, or a series with interval_s above 0, found kind {kind}, rate {rate_per_s}, interval {interval_s}"
                )));
            }
        }
        target.values.iter_mut().zip(values).for_each(|(to, value)| *to = *value);
        *seq += 1;
        let (boot_id, seq, t_publish_ns) = (*boot_id, *seq, now_ns());
        Ok(port.publish(Target { boot_id, seq, t_publish_ns, owner: *owner, ..target })?)
    })
}

/// # Safety
/// `writer` is live and used by the thread that opened it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_writer_send_reading(
    writer: *mut softtwin_writer,
    pressure_mpa: f64,
    gap_mm: f64,
    measured_force_n: f64,
) -> softtwin_status {
    // SAFETY: the caller's promise is passed on; there is no name and no value.
    unsafe {
        softtwin_writer_send_inputs(
            writer,
            pressure_mpa,
            gap_mm,
            measured_force_n,
            std::ptr::null(),
            std::ptr::null(),
            0,
        )
    }
}

/// # Safety
/// `writer` is live and used by the thread that opened it; `names` points to `count` zero-terminated strings and `values` to `count` numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_writer_send_inputs(
    writer: *mut softtwin_writer,
    pressure_mpa: f64,
    gap_mm: f64,
    measured_force_n: f64,
    names: *const *const c_char,
    values: *const f64,
    count: usize,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let softtwin_writer { port: Port::Sensor(port), boot_id, seq } = (unsafe { handle(writer) })? else {
            return Err(argument("this writer is not one of readings"));
        };
        if count > PARAMETERS_MAX {
            return Err(argument(&format!("expected at most {PARAMETERS_MAX} named inputs, found {count}")));
        }
        if count > 0 && (names.is_null() || values.is_null()) {
            return Err(argument("names or values are null"));
        }
        let mut sample = SensorSample { pressure_mpa, gap_mm, measured_force_n, ..SensorSample::default() };
        for at in 0..count {
            // SAFETY: not null, and as many as `count` by the caller's promise.
            let (name, value) = unsafe { (name(*names.add(at))?, *values.add(at)) };
            if !(1..=NAME_BYTES).contains(&name.len()) || sample.inputs().any(|(other, _)| other == name) {
                return Err(argument(&format!(
                    "input {at}: expected a name of 1 to {NAME_BYTES} bytes that no other input has, found {name:?}"
                )));
            }
            sample.add_input(name, value);
        }
        *seq += 1;
        Ok(port.publish(SensorSample { boot_id: *boot_id, seq: *seq, t_sensor_ns: now_ns(), ..sample })?)
    })
}

/// # Safety
/// `writer` is live and used by the thread that opened it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_writer_send_command(
    writer: *mut softtwin_writer,
    pressure_mpa: f64,
    t_sensor_ns: u64,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let softtwin_writer { port: Port::Command(port), boot_id, seq } = (unsafe { handle(writer) })? else {
            return Err(argument("this writer is not one of commands"));
        };
        *seq += 1;
        let (boot_id, seq, t_publish_ns) = (*boot_id, *seq, now_ns());
        Ok(port.publish(Command { boot_id, seq, t_sensor_ns, t_publish_ns, pressure_mpa })?)
    })
}

/// # Safety
/// `writer` is null or came from `softtwin_writer_open` and is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_writer_close(writer: *mut softtwin_writer) {
    // SAFETY: by the caller's promise.
    unsafe { take(writer) }
}
