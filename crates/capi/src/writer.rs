//! Writers: readings in place of a bridge, pressure commands.

use crate::border::{argument, call, give, handle, name, take};
use crate::bus::softtwin_bus;
use crate::reader::topic;
use crate::status::softtwin_status;
use std::ffi::c_char;
use wire::{Command, CommandWriter, SensorSample, SensorWriter, TopicKind, boot_id, now_ns};

/// The one writer of a topic of readings or commands.
pub struct softtwin_writer {
    port: Port,
    boot_id: u64,
    seq: u64,
}

enum Port {
    Sensor(SensorWriter),
    Command(CommandWriter),
}

/// Becomes the writer of `softtwin/<name>/<kind>`; kind: `sensor` or `command`.
///
/// # Safety
/// `bus` is live, texts are zero-terminated, `out` points to memory for a pointer.
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
            TopicKind::Sensor => Port::Sensor(SensorWriter::create(&bus.0, &topic)?),
            TopicKind::Command => Port::Command(CommandWriter::create(&bus.0, &topic)?),
            _ => return Err(argument(&format!("{topic} is the twin's own; expected sensor or command"))),
        };
        // SAFETY: by the caller's promise.
        unsafe { give(out, softtwin_writer { port, boot_id: boot_id(), seq: 0 }) }
    })
}

/// Sends one reading, stamped now: gauge pressure in MPa, gap in mm and measured contact force in N (NaN: not measured).
///
/// # Safety
/// `writer` is live and used by its own thread.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_writer_send_reading(
    writer: *mut softtwin_writer,
    pressure_mpa: f64,
    gap_mm: f64,
    measured_force_n: f64,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let softtwin_writer { port: Port::Sensor(port), boot_id, seq } = (unsafe { handle(writer) })? else {
            return Err(argument("this writer is not one of readings"));
        };
        *seq += 1;
        let (boot_id, seq, t_sensor_ns) = (*boot_id, *seq, now_ns());
        let stamped = SensorSample { boot_id, seq, t_sensor_ns, ..SensorSample::default() };
        Ok(port.publish(SensorSample { pressure_mpa, gap_mm, measured_force_n, ..stamped })?)
    })
}

/// Sends one command: the gauge pressure wanted, MPa, and the stamp of the reading that it answers (0: none).
///
/// # Safety
/// `writer` is live and used by its own thread.
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
        Ok(port.publish(Command {
            boot_id,
            seq,
            t_sensor_ns,
            t_publish_ns,
            pressure_mpa,
            ..Command::default()
        })?)
    })
}

/// Ends a writer.
///
/// # Safety
/// `writer` is null or came from `softtwin_writer_open` and is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_writer_close(writer: *mut softtwin_writer) {
    // SAFETY: by the caller's promise.
    unsafe { take(writer) }
}
