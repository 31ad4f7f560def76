//! Serial lines.

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
    /// Parity bit.
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

/// Parity bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Parity {
    /// None.
    #[default]
    None,
    /// Even.
    Even,
    /// Odd.
    Odd,
}

impl SerialSpec {
    /// Opens the line and forgets what was waiting on it: a late answer must not pass for the next one.
    ///
    /// # Errors
    /// The system's refusal.
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

    /// Everything that is wrong with it.
    pub fn problems(&self, key: &str, problems: &mut Vec<String>) {
        if self.port.as_os_str().is_empty() {
            problems.push(format!("{key}.port: expected a device such as /dev/ttyUSB0, found nothing"));
        }
        if !(300..=4_000_000).contains(&self.baud) {
            problems.push(format!("{key}.baud: expected 300 to 4000000, found {}", self.baud));
        }
        if !matches!(self.data_bits, 7 | 8) {
            problems.push(format!("{key}.data_bits: expected 7 or 8, found {}", self.data_bits));
        }
        if !matches!(self.stop_bits, 1 | 2) {
            problems.push(format!("{key}.stop_bits: expected 1 or 2, found {}", self.stop_bits));
        }
    }
}
