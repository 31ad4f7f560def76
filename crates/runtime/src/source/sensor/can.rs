//! CAN: signals in frames of a bus, through the kernel's socket. Bits are counted as in .dbc files.

use super::devices::Device;
use super::feed::{Backoff, Feed, STOP_CHECK};
use serde::{Deserialize, Serialize};
use std::ffi::CString;
use std::io;
use std::mem::{size_of, zeroed};
use std::os::fd::{AsRawFd, FromRawFd, OwnedFd};
use std::time::Duration;
use tokio::runtime::Runtime;
use wire::now_ns;

/// Longest pause between attempts to open the interface again.
const MAX_BACKOFF: Duration = Duration::from_secs(5);
/// Data of a frame.
pub const FRAME_BYTES: usize = 8;

/// Where a number stands in the frames of a bus, as a .dbc file says it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CanSignal {
    /// Identifier of the frame; above 0x7ff, or with `extended`, one of 29 bits.
    pub id: u32,
    /// Whether the identifier has 29 bits; default: when it is above 0x7ff.
    #[serde(default)]
    pub extended: Option<bool>,
    /// First bit: the lowest of a little-endian number, the highest of a big-endian one; bit 0 is the lowest of byte 0, bit
    /// 8 the lowest of byte 1.
    pub start_bit: u8,
    /// How many bits, 1 to 64.
    pub bits: u8,
    /// Which byte comes first.
    #[serde(default)]
    pub byte_order: ByteOrder,
    /// What the bits are.
    #[serde(default)]
    pub number: CanNumber,
}

/// Which byte of a number comes first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ByteOrder {
    /// The low one ("Intel", `@1` in .dbc files).
    #[default]
    Little,
    /// The high one ("Motorola", `@0`).
    Big,
}

/// What the bits of a signal are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CanNumber {
    /// A whole number from 0.
    #[default]
    Unsigned,
    /// Two's complement.
    Signed,
    /// IEEE 754, 32 or 64 bits.
    Float,
}

impl CanSignal {
    /// The identifier as the kernel has it: with the flag of 29 bits.
    pub fn kernel_id(&self) -> u32 {
        if self.extended.unwrap_or(self.id > libc::CAN_SFF_MASK) {
            self.id | libc::CAN_EFF_FLAG
        } else {
            self.id
        }
    }

    /// Places of the bits in the data, the number's lowest first; `None` beyond 64 bits of data.
    fn places(&self) -> Option<Vec<usize>> {
        let last = 8 * FRAME_BYTES;
        let (start, bits) = (usize::from(self.start_bit), usize::from(self.bits));
        if self.byte_order == ByteOrder::Little {
            return (start + bits <= last).then(|| (start..start + bits).collect());
        }
        // From the highest down to the lowest bit of a byte, then on with the highest of the next byte.
        let mut place = start;
        let mut places = Vec::with_capacity(bits);
        for _ in 0..bits {
            if place >= last {
                return None;
            }
            places.push(place);
            place = if place.is_multiple_of(8) { place + 15 } else { place - 1 };
        }
        places.reverse();
        Some(places)
    }

    /// The number in a frame's data; `None` when the frame is too short for it.
    pub fn decode(&self, data: &[u8]) -> Option<f64> {
        let mut raw = 0u64;
        for (bit, place) in self.places()?.into_iter().enumerate() {
            let byte = data.get(place / 8)?;
            raw |= u64::from(byte >> (place % 8) & 1) << bit;
        }
        let unused = 64 - u32::from(self.bits);
        Some(match self.number {
            CanNumber::Unsigned => raw as f64,
            CanNumber::Signed => ((raw << unused).cast_signed() >> unused) as f64,
            CanNumber::Float if self.bits == 32 => f32::from_bits(raw as u32).into(),
            CanNumber::Float => f64::from_bits(raw),
        })
    }

    pub(super) fn problems(&self, key: &str, problems: &mut Vec<String>) {
        let mask = if self.extended == Some(false) { libc::CAN_SFF_MASK } else { libc::CAN_EFF_MASK };
        if self.id > mask {
            problems.push(format!("{key}.id: expected at most {mask:#x}, found {:#x}", self.id));
        }
        if !(1..=64).contains(&self.bits) {
            problems.push(format!("{key}.bits: expected 1 to 64, found {}", self.bits));
        } else if self.places().is_none() {
            problems.push(format!(
                "{key}.start_bit, bits: expected a number within 64 bits of data, found {} bits from bit {}",
                self.bits, self.start_bit
            ));
        }
        if self.number == CanNumber::Float && !matches!(self.bits, 32 | 64) {
            problems.push(format!("{key}.bits: expected 32 or 64 for a float, found {}", self.bits));
        }
    }
}

/// The signals of one sensor on one interface.
#[derive(Debug)]
pub(super) struct CanDevice {
    pub(super) interface: String,
    /// In the order of the feed's values.
    pub(super) signals: Vec<CanSignal>,
}

impl Device for CanDevice {
    fn run(self: Box<Self>, mut feed: Feed, _: &Runtime) {
        let mut backoff = Backoff::new(MAX_BACKOFF);
        while !feed.is_stopped() {
            match self.open() {
                Ok(socket) => self.read(&socket, &mut feed, &mut backoff),
                Err(error) => feed.failed(|c| &c.refusals, &format!("cannot open it: {error}")),
            }
            backoff.sleep(|| !feed.is_stopped());
        }
    }
}

impl CanDevice {
    /// A socket that gets the frames of these signals only, and gives up waiting after a while.
    fn open(&self) -> io::Result<OwnedFd> {
        let name = CString::new(self.interface.as_str())?;
        // SAFETY: a new descriptor, owned from here on where there is one.
        let raw = checked(unsafe {
            libc::socket(libc::PF_CAN, libc::SOCK_RAW | libc::SOCK_CLOEXEC, libc::CAN_RAW)
        })?;
        // SAFETY: as above.
        let socket = unsafe { OwnedFd::from_raw_fd(raw) };
        // SAFETY: the name ends with 0 and lives through the call.
        let index = unsafe { libc::if_nametoindex(name.as_ptr()) };
        if index == 0 {
            return Err(io::Error::last_os_error());
        }
        let filters: Vec<libc::can_filter> = self
            .signals
            .iter()
            .map(|signal| libc::can_filter {
                can_id: signal.kernel_id(),
                can_mask: libc::CAN_EFF_FLAG | libc::CAN_RTR_FLAG | libc::CAN_EFF_MASK,
            })
            .collect();
        set(&socket, libc::SOL_CAN_RAW, libc::CAN_RAW_FILTER, filters.as_slice())?;
        let wait = libc::timeval { tv_sec: 0, tv_usec: STOP_CHECK.as_micros() as libc::suseconds_t };
        set(&socket, libc::SOL_SOCKET, libc::SO_RCVTIMEO, &[wait])?;
        // SAFETY: all zeros is a value of this plain structure.
        let mut address: libc::sockaddr_can = unsafe { zeroed() };
        address.can_family = libc::AF_CAN as libc::sa_family_t;
        address.can_ifindex = index.cast_signed();
        // SAFETY: address and length belong together.
        checked(unsafe {
            let length = size_of::<libc::sockaddr_can>() as libc::socklen_t;
            libc::bind(socket.as_raw_fd(), (&raw const address).cast(), length)
        })?;
        Ok(socket)
    }

    fn read(&self, socket: &OwnedFd, feed: &mut Feed, backoff: &mut Backoff) {
        while !feed.is_stopped() {
            // SAFETY: all zeros is a value of this plain structure.
            let mut frame: libc::can_frame = unsafe { zeroed() };
            // SAFETY: the kernel writes at most the frame's size.
            let count = unsafe {
                libc::read(socket.as_raw_fd(), (&raw mut frame).cast(), size_of::<libc::can_frame>())
            };
            if count < 0 {
                let error = io::Error::last_os_error();
                if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted) {
                    continue; // nothing sent: check the stop flag, go on reading
                }
                return feed.failed(|c| &c.disconnects, &error.to_string());
            }
            backoff.reset();
            let data = frame.data.get(..usize::from(frame.can_dlc)).unwrap_or(&frame.data);
            self.take(frame.can_id, data, feed);
        }
    }

    /// Hands over the signals of a frame.
    fn take(&self, id: u32, data: &[u8], feed: &mut Feed) {
        let mine = || self.signals.iter().enumerate().filter(|(_, signal)| signal.kernel_id() == id);
        let found: Vec<(usize, f64)> =
            mine().filter_map(|(position, signal)| Some((position, signal.decode(data)?))).collect();
        if found.len() < mine().count() {
            let text = format!("frame {id:#x} has {} bytes, fewer than its signals need", data.len());
            feed.failed(|c| &c.garbage, &text);
        } else if !found.is_empty() {
            feed.send(now_ns(), found);
        }
    }
}

fn checked(result: libc::c_int) -> io::Result<libc::c_int> {
    if result < 0 { Err(io::Error::last_os_error()) } else { Ok(result) }
}

fn set<T>(socket: &OwnedFd, level: libc::c_int, name: libc::c_int, values: &[T]) -> io::Result<()> {
    // SAFETY: pointer and length are those of the slice.
    let result = unsafe {
        let length = size_of_val(values) as libc::socklen_t;
        libc::setsockopt(socket.as_raw_fd(), level, name, values.as_ptr().cast(), length)
    };
    checked(result).map(|_| ())
}

#[cfg(test)]
#[path = "../../../tests/unit/source_sensor_can.rs"]
mod tests;
