//! Serial lines, and the paths of Modbus devices.

use crate::problems::Problems;
use serde::{Deserialize, Serialize};
use std::io;
use std::path::PathBuf;
use tokio_serial::{ClearBuffer, DataBits, SerialPort, SerialPortBuilderExt, SerialStream, StopBits};

/// A serial line as written in a scene file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SerialSpec {
    /// Device, such as `/dev/ttyUSB0`.
    pub port: PathBuf,
    /// Bits per second.
    #[serde(default = "usual_baud")]
    pub baud: u32,
    /// Bits of a character: 7 or 8.
    #[serde(default = "eight")]
    pub data_bits: u8,
    #[serde(default)]
    pub parity: Parity,
    /// Stop bits: 1 or 2.
    #[serde(default = "one")]
    pub stop_bits: u8,
}

fn usual_baud() -> u32 {
    9600
}

fn eight() -> u8 {
    8
}

fn one() -> u8 {
    1
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Parity {
    #[default]
    None,
    Even,
    Odd,
}

impl SerialSpec {
    /// Opens the line and discards waiting bytes: a late answer must not be taken for the next one.
    pub fn open(&self) -> io::Result<SerialStream> {
        let parity = match self.parity {
            Parity::None => tokio_serial::Parity::None,
            Parity::Even => tokio_serial::Parity::Even,
            Parity::Odd => tokio_serial::Parity::Odd,
        };
        let stream = tokio_serial::new(self.port.to_string_lossy(), self.baud)
            .data_bits(if self.data_bits == 7 { DataBits::Seven } else { DataBits::Eight })
            .parity(parity)
            .stop_bits(if self.stop_bits == 2 { StopBits::Two } else { StopBits::One })
            .open_native_async()?;
        stream.clear(ClearBuffer::Input)?;
        Ok(stream)
    }

    /// All errors in it.
    pub fn problems(&self, problems: &mut Problems) {
        let is_named = !self.port.as_os_str().is_empty();
        problems.expect(is_named, "port", "a device such as /dev/ttyUSB0", "nothing");
        let fits = (300..=4_000_000).contains(&self.baud);
        problems.expect(fits, "baud", "300 to 4000000", self.baud);
        problems.expect(matches!(self.data_bits, 7 | 8), "data_bits", "7 or 8", self.data_bits);
        problems.expect(matches!(self.stop_bits, 1 | 2), "stop_bits", "1 or 2", self.stop_bits);
    }
}

/// Where Modbus devices are reached.
#[derive(Debug, Clone, PartialEq)]
pub enum ModbusPath {
    /// Modbus TCP: `host:port`.
    Tcp(String),
    /// Modbus RTU.
    Serial(SerialSpec),
}

impl ModbusPath {
    /// The path of a checked specification; `None` unless exactly one of the two is there.
    pub fn new(tcp: Option<&str>, serial: Option<&SerialSpec>) -> Option<Self> {
        match (tcp, serial) {
            (Some(address), None) => Some(Self::Tcp(address.to_owned())),
            (None, Some(serial)) => Some(Self::Serial(serial.clone())),
            _ => None,
        }
    }

    /// Adds all errors in the two keys.
    pub(crate) fn problems(tcp: Option<&str>, serial: Option<&SerialSpec>, problems: &mut Problems) {
        let found = if tcp.is_some() { "both" } else { "neither" };
        problems.expect(tcp.is_some() != serial.is_some(), "tcp, serial", "exactly one of them", found);
        if let Some(address) = tcp {
            check_address(address, "tcp", problems);
        }
        if let Some(serial) = serial {
            serial.problems(&mut problems.part("serial"));
        }
    }

    /// Names the path among those of a scene.
    pub(super) fn key(&self) -> String {
        match self {
            Self::Tcp(address) => format!("modbus tcp {address}"),
            Self::Serial(serial) => format!("serial {}", serial.port.display()),
        }
    }

    /// Text for the log.
    pub(super) fn place(&self) -> String {
        match self {
            Self::Tcp(address) => address.clone(),
            Self::Serial(serial) => serial.port.display().to_string(),
        }
    }
}

/// Notes a problem unless it is `host:port`.
pub(super) fn check_address(address: &str, key: &str, problems: &mut Problems) {
    let parts = address.rsplit_once(':');
    let fits = parts.is_some_and(|(host, port)| !host.is_empty() && port.parse::<u16>().is_ok());
    problems.expect(fits, key, "`host:port`", format_args!("`{address}`"));
}
