//! Devices of valves. A write succeeds only with the device's confirmation; after a failure the connection is reopened, so that
//! a late answer is not taken for the next one.

use super::spec::{IioValve, LinesValve, ModbusValve, ValveSpec};
use crate::source::{ModbusConnection, SerialSpec};
use std::io::Write;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::runtime::Runtime;
use tokio::time::timeout;

/// Longest line that is read as a reply.
const MAX_REPLY: usize = 256;

/// A device that takes pressures.
pub(super) struct Device {
    runtime: Runtime,
    kind: DeviceKind,
}

enum DeviceKind {
    /// With the number of the connection that knows the device's own time-out.
    Modbus(ModbusValve, ModbusConnection, u64),
    Lines(LinesValve, Option<Box<dyn Port>>),
    Iio(IioValve),
}

/// A connection for bytes.
trait Port: AsyncRead + AsyncWrite + Unpin + Send {}
impl<T: AsyncRead + AsyncWrite + Unpin + Send> Port for T {}

impl Device {
    /// Device of a checked specification, not connected yet; `None` if it names no device. A Modbus device writes through `modbus`,
    /// which sensors may use as well.
    ///
    /// # Errors
    /// The system refuses what asynchronous input and output need.
    pub(super) fn new(spec: &ValveSpec, modbus: Option<ModbusConnection>) -> std::io::Result<Option<Self>> {
        let kind = match (&spec.modbus, modbus, &spec.lines, &spec.iio) {
            (Some(spec), Some(connection), _, _) => DeviceKind::Modbus(spec.clone(), connection, 0),
            (_, _, Some(lines), _) => DeviceKind::Lines(lines.clone(), None),
            (_, _, _, Some(iio)) => DeviceKind::Iio(iio.clone()),
            _ => return Ok(None),
        };
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        Ok(Some(Self { runtime, kind }))
    }

    /// Writes a pressure in MPa and waits until the device confirms it, at most for its time-out; connects first where
    /// there is no connection.
    ///
    /// # Errors
    /// Message for the log.
    pub(super) fn write(&mut self, pressure_mpa: f64) -> Result<(), String> {
        let Self { runtime, kind } = self;
        match kind {
            DeviceKind::Modbus(spec, connection, number) => {
                write_modbus(spec, connection, number, pressure_mpa)
            }
            DeviceKind::Lines(spec, port) => {
                let limit = Duration::from_secs_f64(spec.timeout_ms * 1e-3);
                let done = runtime.block_on(within(limit, write_line(spec, port, pressure_mpa)));
                done.inspect_err(|_| *port = None)
            }
            DeviceKind::Iio(spec) => write_iio(spec, pressure_mpa),
        }
    }
}

async fn within(limit: Duration, work: impl Future<Output = Result<(), String>>) -> Result<(), String> {
    let late = || Err(format!("no answer within {} ms", limit.as_secs_f64() * 1e3));
    timeout(limit, work).await.unwrap_or_else(|_| late())
}

async fn connect(address: &str) -> Result<TcpStream, String> {
    let stream = TcpStream::connect(address).await.map_err(|error| format!("cannot connect: {error}"))?;
    // Writes are a dozen bytes: waiting to fill a packet would cost 40 ms each.
    stream.set_nodelay(true).map_err(|error| error.to_string())?;
    Ok(stream)
}

fn open(serial: &SerialSpec) -> Result<tokio_serial::SerialStream, String> {
    serial.open().map_err(|error| format!("cannot open it: {error}"))
}

/// The device's own time-out first, on every new connection: the device may have been off meanwhile.
fn write_modbus(
    spec: &ModbusValve,
    connection: &ModbusConnection,
    number: &mut u64,
    pressure_mpa: f64,
) -> Result<(), String> {
    let limit = Duration::from_secs_f64(spec.timeout_ms * 1e-3);
    let unit_id = spec.value.from.unit_id;
    let watchdog = |number: u64| match spec.watchdog {
        Some(watchdog) => connection.write(unit_id, watchdog.register, &[watchdog.raw], limit),
        None => Ok(number),
    };
    if *number == 0 {
        *number = watchdog(0)?;
    }
    let words = spec.registers(pressure_mpa);
    let words = words.ok_or_else(|| format!("{pressure_mpa} MPa does not fit into the register"))?;
    let found = connection.write(unit_id, spec.value.from.register, &words, limit)?;
    if found != *number {
        *number = watchdog(found)?;
    }
    Ok(())
}

async fn write_line(
    spec: &LinesValve,
    port: &mut Option<Box<dyn Port>>,
    pressure_mpa: f64,
) -> Result<(), String> {
    let port = match port {
        Some(port) => port,
        None => port.insert(match (&spec.serial, &spec.tcp) {
            (Some(serial), _) => Box::new(open(serial)?) as Box<dyn Port>,
            (None, address) => Box::new(connect(address.as_deref().unwrap_or_default()).await?),
        }),
    };
    port.write_all(spec.line(pressure_mpa).as_bytes()).await.map_err(|error| error.to_string())?;
    port.flush().await.map_err(|error| error.to_string())?;
    let Some(expected) = &spec.reply else { return Ok(()) };
    let reply = read_line(port).await?;
    if reply.starts_with(expected.as_str()) {
        return Ok(());
    }
    Err(format!("expected a line that begins with `{expected}`, the device sent `{reply}`"))
}

async fn read_line(port: &mut Box<dyn Port>) -> Result<String, String> {
    let mut line = Vec::new();
    while line.len() < MAX_REPLY {
        match port.read_u8().await.map_err(|error| error.to_string())? {
            b'\n' | b'\r' if line.is_empty() => {}
            b'\n' | b'\r' => return Ok(String::from_utf8_lossy(&line).into_owned()),
            byte => line.push(byte),
        }
    }
    Err(format!("the device sent {MAX_REPLY} bytes without the end of a line"))
}

/// The driver takes the number with the write, or refuses it. The file is the kernel's: it must be there already.
fn write_iio(spec: &IioValve, pressure_mpa: f64) -> Result<(), String> {
    let raw = spec.raw(pressure_mpa).ok_or_else(|| format!("{pressure_mpa} MPa is beyond the converter"))?;
    let path = spec.path();
    let mut file = std::fs::OpenOptions::new().write(true).truncate(true).open(&path);
    let file = file.as_mut().map_err(|error| format!("{}: {error}", path.display()))?;
    writeln!(file, "{raw}").map_err(|error| format!("{}: {error}", path.display()))
}

#[cfg(test)]
#[path = "../../tests/unit/valve_device.rs"]
mod tests;
