//! Topics with a payload of fixed size: read by copy (at most 752 bytes), woken by event.

use crate::border::{Failure, call, give, handle, name, put, take};
use crate::bus::softtwin_bus;
use crate::status::softtwin_status;
use std::ffi::c_char;
use std::time::{Duration, Instant};
use wire::{
    Command, CommandReader, CommandWriter, Grasp, GraspReader, Health, HealthReader, SensorReader,
    SensorSample, SensorWriter, State, StateReader, Topic, WakeSet, Wakeable, WireError, boot_id, now_ns,
};

/// A reader with its wait.
pub(crate) struct Waiting<R> {
    pub(crate) reader: R,
    wake: WakeSet,
}

impl<R: Wakeable> Waiting<R> {
    pub(crate) fn new(reader: R) -> Self {
        let wake = WakeSet::new([&reader as &dyn Wakeable]);
        Self { reader, wake }
    }

    /// Takes what `take` finds; waits for it at most `timeout_ms`. Below 0: for ever.
    pub(crate) fn next<T>(
        &mut self,
        timeout_ms: i64,
        mut take: impl FnMut(&R) -> Result<Option<T>, WireError>,
    ) -> Result<T, Failure> {
        let end = u64::try_from(timeout_ms).ok().map(|ms| Instant::now() + Duration::from_millis(ms));
        loop {
            if let Some(found) = take(&self.reader)? {
                return Ok(found);
            }
            let left =
                end.map_or(Duration::from_secs(3600), |end| end.saturating_duration_since(Instant::now()));
            if left.is_zero() {
                let text = format!("nothing came within {timeout_ms} ms");
                return Err(Failure::Own(softtwin_status::SOFTTWIN_TIMEOUT, text));
            }
            self.wake.wait([&self.reader as &dyn Wakeable], left)?;
        }
    }
}

/// A reader of `softtwin/<actuator>/state`.
pub struct softtwin_state_reader(Waiting<StateReader>);

/// Opens a reader of states; the topic must exist.
///
/// # Safety
/// `bus` is live, `actuator` zero-terminated, `out` points to memory for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_state_reader_open(
    bus: *mut softtwin_bus,
    actuator: *const c_char,
    out: *mut *mut softtwin_state_reader,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let (bus, name) = unsafe { (handle(bus)?, name(actuator)?) };
        let reader = StateReader::open(&bus.0, &Topic::state(name)?)?;
        // SAFETY: by the caller's promise.
        unsafe { give(out, softtwin_state_reader(Waiting::new(reader))) }
    })
}

/// Copies the oldest waiting sample to `out`; waits for one at most `timeout_ms` (0: does not wait, below 0: for ever).
///
/// # Safety
/// `reader` is live and used by its own thread, `out` points to memory for the payload.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_state_reader_next(
    reader: *mut softtwin_state_reader,
    timeout_ms: i64,
    out: *mut State,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let found = unsafe { handle(reader) }?.0.next(timeout_ms, StateReader::next)?;
        // SAFETY: by the caller's promise.
        unsafe { put(out, found) }
    })
}

/// As `softtwin_state_reader_next`, with the newest waiting sample; older ones are passed over.
///
/// # Safety
/// As `softtwin_state_reader_next`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_state_reader_newest(
    reader: *mut softtwin_state_reader,
    timeout_ms: i64,
    out: *mut State,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let found = unsafe { handle(reader) }?.0.next(timeout_ms, StateReader::newest)?;
        // SAFETY: by the caller's promise.
        unsafe { put(out, found) }
    })
}

/// Ends a reader.
///
/// # Safety
/// `reader` is null or came from `softtwin_state_reader_open` and is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_state_reader_close(reader: *mut softtwin_state_reader) {
    // SAFETY: by the caller's promise.
    unsafe { take(reader) }
}

/// A reader of `softtwin/<actuator>/health`.
pub struct softtwin_health_reader(Waiting<HealthReader>);

/// Opens a reader of health; the topic must exist.
///
/// # Safety
/// `bus` is live, `actuator` zero-terminated, `out` points to memory for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_health_reader_open(
    bus: *mut softtwin_bus,
    actuator: *const c_char,
    out: *mut *mut softtwin_health_reader,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let (bus, name) = unsafe { (handle(bus)?, name(actuator)?) };
        let reader = HealthReader::open(&bus.0, &Topic::health(name)?)?;
        // SAFETY: by the caller's promise.
        unsafe { give(out, softtwin_health_reader(Waiting::new(reader))) }
    })
}

/// Copies the oldest waiting sample to `out`; waits for one at most `timeout_ms` (0: does not wait, below 0: for ever).
///
/// # Safety
/// `reader` is live and used by its own thread, `out` points to memory for the payload.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_health_reader_next(
    reader: *mut softtwin_health_reader,
    timeout_ms: i64,
    out: *mut Health,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let found = unsafe { handle(reader) }?.0.next(timeout_ms, HealthReader::next)?;
        // SAFETY: by the caller's promise.
        unsafe { put(out, found) }
    })
}

/// As `softtwin_health_reader_next`, with the newest waiting sample; older ones are passed over.
///
/// # Safety
/// As `softtwin_health_reader_next`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_health_reader_newest(
    reader: *mut softtwin_health_reader,
    timeout_ms: i64,
    out: *mut Health,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let found = unsafe { handle(reader) }?.0.next(timeout_ms, HealthReader::newest)?;
        // SAFETY: by the caller's promise.
        unsafe { put(out, found) }
    })
}

/// Ends a reader.
///
/// # Safety
/// `reader` is null or came from `softtwin_health_reader_open` and is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_health_reader_close(reader: *mut softtwin_health_reader) {
    // SAFETY: by the caller's promise.
    unsafe { take(reader) }
}

/// A reader of `softtwin/<scene>/grasp`.
pub struct softtwin_grasp_reader(Waiting<GraspReader>);

/// Opens a reader of grasps; the topic must exist.
///
/// # Safety
/// `bus` is live, `scene` zero-terminated, `out` points to memory for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_grasp_reader_open(
    bus: *mut softtwin_bus,
    scene: *const c_char,
    out: *mut *mut softtwin_grasp_reader,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let (bus, name) = unsafe { (handle(bus)?, name(scene)?) };
        let reader = GraspReader::open(&bus.0, &Topic::grasp(name)?)?;
        // SAFETY: by the caller's promise.
        unsafe { give(out, softtwin_grasp_reader(Waiting::new(reader))) }
    })
}

/// Copies the oldest waiting sample to `out`; waits for one at most `timeout_ms` (0: does not wait, below 0: for ever).
///
/// # Safety
/// `reader` is live and used by its own thread, `out` points to memory for the payload.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_grasp_reader_next(
    reader: *mut softtwin_grasp_reader,
    timeout_ms: i64,
    out: *mut Grasp,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let found = unsafe { handle(reader) }?.0.next(timeout_ms, GraspReader::next)?;
        // SAFETY: by the caller's promise.
        unsafe { put(out, found) }
    })
}

/// As `softtwin_grasp_reader_next`, with the newest waiting sample; older ones are passed over.
///
/// # Safety
/// As `softtwin_grasp_reader_next`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_grasp_reader_newest(
    reader: *mut softtwin_grasp_reader,
    timeout_ms: i64,
    out: *mut Grasp,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let found = unsafe { handle(reader) }?.0.next(timeout_ms, GraspReader::newest)?;
        // SAFETY: by the caller's promise.
        unsafe { put(out, found) }
    })
}

/// Ends a reader.
///
/// # Safety
/// `reader` is null or came from `softtwin_grasp_reader_open` and is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_grasp_reader_close(reader: *mut softtwin_grasp_reader) {
    // SAFETY: by the caller's promise.
    unsafe { take(reader) }
}

/// A reader of `softtwin/<actuator>/sensor`.
pub struct softtwin_sensor_reader(Waiting<SensorReader>);

/// Opens a reader of readings; the topic must exist.
///
/// # Safety
/// `bus` is live, `actuator` zero-terminated, `out` points to memory for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_sensor_reader_open(
    bus: *mut softtwin_bus,
    actuator: *const c_char,
    out: *mut *mut softtwin_sensor_reader,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let (bus, name) = unsafe { (handle(bus)?, name(actuator)?) };
        let reader = SensorReader::open(&bus.0, &Topic::sensor(name)?)?;
        // SAFETY: by the caller's promise.
        unsafe { give(out, softtwin_sensor_reader(Waiting::new(reader))) }
    })
}

/// Copies the oldest waiting sample to `out`; waits for one at most `timeout_ms` (0: does not wait, below 0: for ever).
///
/// # Safety
/// `reader` is live and used by its own thread, `out` points to memory for the payload.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_sensor_reader_next(
    reader: *mut softtwin_sensor_reader,
    timeout_ms: i64,
    out: *mut SensorSample,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let found = unsafe { handle(reader) }?.0.next(timeout_ms, SensorReader::next)?;
        // SAFETY: by the caller's promise.
        unsafe { put(out, found) }
    })
}

/// As `softtwin_sensor_reader_next`, with the newest waiting sample; older ones are passed over.
///
/// # Safety
/// As `softtwin_sensor_reader_next`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_sensor_reader_newest(
    reader: *mut softtwin_sensor_reader,
    timeout_ms: i64,
    out: *mut SensorSample,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let found = unsafe { handle(reader) }?.0.next(timeout_ms, SensorReader::newest)?;
        // SAFETY: by the caller's promise.
        unsafe { put(out, found) }
    })
}

/// Ends a reader.
///
/// # Safety
/// `reader` is null or came from `softtwin_sensor_reader_open` and is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_sensor_reader_close(reader: *mut softtwin_sensor_reader) {
    // SAFETY: by the caller's promise.
    unsafe { take(reader) }
}

/// A reader of `softtwin/<actuator>/command`.
pub struct softtwin_command_reader(Waiting<CommandReader>);

/// Opens a reader of pressure commands; the topic must exist.
///
/// # Safety
/// `bus` is live, `actuator` zero-terminated, `out` points to memory for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_command_reader_open(
    bus: *mut softtwin_bus,
    actuator: *const c_char,
    out: *mut *mut softtwin_command_reader,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let (bus, name) = unsafe { (handle(bus)?, name(actuator)?) };
        let reader = CommandReader::open(&bus.0, &Topic::command(name)?)?;
        // SAFETY: by the caller's promise.
        unsafe { give(out, softtwin_command_reader(Waiting::new(reader))) }
    })
}

/// Copies the oldest waiting sample to `out`; waits for one at most `timeout_ms` (0: does not wait, below 0: for ever).
///
/// # Safety
/// `reader` is live and used by its own thread, `out` points to memory for the payload.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_command_reader_next(
    reader: *mut softtwin_command_reader,
    timeout_ms: i64,
    out: *mut Command,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let found = unsafe { handle(reader) }?.0.next(timeout_ms, CommandReader::next)?;
        // SAFETY: by the caller's promise.
        unsafe { put(out, found) }
    })
}

/// As `softtwin_command_reader_next`, with the newest waiting sample; older ones are passed over.
///
/// # Safety
/// As `softtwin_command_reader_next`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_command_reader_newest(
    reader: *mut softtwin_command_reader,
    timeout_ms: i64,
    out: *mut Command,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let found = unsafe { handle(reader) }?.0.next(timeout_ms, CommandReader::newest)?;
        // SAFETY: by the caller's promise.
        unsafe { put(out, found) }
    })
}

/// Ends a reader.
///
/// # Safety
/// `reader` is null or came from `softtwin_command_reader_open` and is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_command_reader_close(reader: *mut softtwin_command_reader) {
    // SAFETY: by the caller's promise.
    unsafe { take(reader) }
}

/// The one writer of `softtwin/<actuator>/sensor`.
pub struct softtwin_sensor_writer {
    writer: SensorWriter,
    boot_id: u64,
    seq: u64,
}

/// Becomes the writer of an actuator's readings, in place of a bridge.
///
/// # Safety
/// `bus` is live, `actuator` zero-terminated, `out` points to memory for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_sensor_writer_open(
    bus: *mut softtwin_bus,
    actuator: *const c_char,
    out: *mut *mut softtwin_sensor_writer,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let (bus, name) = unsafe { (handle(bus)?, name(actuator)?) };
        let writer = SensorWriter::create(&bus.0, &Topic::sensor(name)?)?;
        // SAFETY: by the caller's promise.
        unsafe { give(out, softtwin_sensor_writer { writer, boot_id: boot_id(), seq: 0 }) }
    })
}

/// Sends one reading, stamped now: gauge pressure in MPa, gap in mm and measured contact force in N (NaN: not measured).
///
/// # Safety
/// `writer` is live and used by its own thread.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_sensor_writer_send(
    writer: *mut softtwin_sensor_writer,
    pressure_mpa: f64,
    gap_mm: f64,
    measured_force_n: f64,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let own = unsafe { handle(writer) }?;
        own.seq += 1;
        let (boot_id, seq, t_sensor_ns) = (own.boot_id, own.seq, now_ns());
        let stamped = SensorSample { boot_id, seq, t_sensor_ns, ..SensorSample::default() };
        Ok(own.writer.publish(SensorSample { pressure_mpa, gap_mm, measured_force_n, ..stamped })?)
    })
}

/// Ends a writer.
///
/// # Safety
/// `writer` is null or came from `softtwin_sensor_writer_open` and is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_sensor_writer_close(writer: *mut softtwin_sensor_writer) {
    // SAFETY: by the caller's promise.
    unsafe { take(writer) }
}

/// The one writer of `softtwin/<actuator>/command`.
pub struct softtwin_command_writer {
    writer: CommandWriter,
    boot_id: u64,
    seq: u64,
}

/// Becomes the writer of an actuator's pressure commands.
///
/// # Safety
/// `bus` is live, `actuator` zero-terminated, `out` points to memory for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_command_writer_open(
    bus: *mut softtwin_bus,
    actuator: *const c_char,
    out: *mut *mut softtwin_command_writer,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let (bus, name) = unsafe { (handle(bus)?, name(actuator)?) };
        let writer = CommandWriter::create(&bus.0, &Topic::command(name)?)?;
        // SAFETY: by the caller's promise.
        unsafe { give(out, softtwin_command_writer { writer, boot_id: boot_id(), seq: 0 }) }
    })
}

/// Sends one command: the gauge pressure wanted, MPa, and the stamp of the reading that it answers (0: none).
///
/// # Safety
/// `writer` is live and used by its own thread.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_command_writer_send(
    writer: *mut softtwin_command_writer,
    pressure_mpa: f64,
    t_sensor_ns: u64,
) -> softtwin_status {
    call(|| {
        // SAFETY: by the caller's promise.
        let own = unsafe { handle(writer) }?;
        own.seq += 1;
        let (boot_id, seq, t_publish_ns) = (own.boot_id, own.seq, now_ns());
        Ok(own.writer.publish(Command {
            boot_id,
            seq,
            t_sensor_ns,
            t_publish_ns,
            pressure_mpa,
            reserved: 0,
        })?)
    })
}

/// Ends a writer.
///
/// # Safety
/// `writer` is null or came from `softtwin_command_writer_open` and is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn softtwin_command_writer_close(writer: *mut softtwin_command_writer) {
    // SAFETY: by the caller's promise.
    unsafe { take(writer) }
}
