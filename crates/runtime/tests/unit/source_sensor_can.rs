//! Tests of `src/source/sensor/can.rs` that need its private parts. The decoder needs no bus.

use super::*;
use crate::source::sensor::calibration::Channel;
use crate::source::sensor::feed::{Ended, connect};
use proptest::prelude::*;
use std::sync::Arc;

fn signal(start_bit: u8, bits: u8, byte_order: ByteOrder, number: CanNumber) -> CanSignal {
    CanSignal { id: 0x123, extended: None, start_bit, bits, byte_order, number }
}

/// Examples with the numbers that cantools gives for the same .dbc signals.
#[test]
fn bits_are_counted_as_in_dbc_files() {
    use {ByteOrder::*, CanNumber::*};
    let data = [0x12, 0x34, 0x56, 0x78, 0x9a, 0xbc, 0xde, 0xf0];
    let decode = |start, bits, order, number| signal(start, bits, order, number).decode(&data);
    assert_eq!(decode(0, 8, Little, Unsigned), Some(f64::from(0x12)));
    assert_eq!(decode(0, 16, Little, Unsigned), Some(f64::from(0x3412)));
    assert_eq!(decode(7, 16, Big, Unsigned), Some(f64::from(0x1234)), "from the highest bit of byte 0 on");
    assert_eq!(decode(4, 8, Little, Unsigned), Some(f64::from(0x41)));
    assert_eq!(decode(3, 8, Big, Unsigned), Some(f64::from(0x23)));
    assert_eq!(decode(32, 8, Little, Signed), Some(f64::from(0x9a - 256)));
    assert_eq!(decode(0, 64, Little, Signed), Some(0xf0de_bc9a_7856_3412_u64.cast_signed() as f64));
    assert_eq!(decode(39, 12, Big, Signed), Some(f64::from(0x9ab - 4096)));
    let bits = 0.0375f32.to_le_bytes();
    assert_eq!(signal(0, 32, Little, Float).decode(&bits), Some(f64::from(0.0375f32)));
    let bits = 0.0375f64.to_be_bytes();
    assert_eq!(signal(7, 64, Big, Float).decode(&bits), Some(0.0375));
    assert_eq!(decode(0, 16, Little, Unsigned).and(signal(0, 16, Little, Unsigned).decode(&data[..1])), None);
}

#[test]
fn what_cannot_stand_in_a_frame_is_told() {
    use {ByteOrder::*, CanNumber::*};
    let told = |signal: CanSignal| {
        let mut problems = Vec::new();
        signal.problems("from", &mut problems);
        problems
    };
    assert!(
        told(signal(0, 64, Little, Unsigned)).is_empty() && told(signal(7, 64, Big, Unsigned)).is_empty()
    );
    assert!(told(signal(1, 64, Little, Unsigned))[0].contains("found 64 bits from bit 1"));
    assert!(told(signal(60, 8, Big, Unsigned))[0].contains("from.start_bit"));
    assert!(told(signal(0, 0, Little, Unsigned))[0].contains("from.bits"));
    assert!(told(signal(0, 16, Little, Float))[0].contains("32 or 64"));
    let far = CanSignal { id: 0x800, extended: Some(false), ..signal(0, 8, Little, Unsigned) };
    assert!(told(far)[0].contains("at most 0x7ff, found 0x800"));
    assert_eq!(CanSignal { id: 0x800, ..far }.kernel_id(), 0x800);
    assert_eq!(CanSignal { extended: None, ..far }.kernel_id(), 0x800 | libc::CAN_EFF_FLAG);
}

/// Frames of several signals, of other identifiers, too short ones.
#[test]
fn a_frame_brings_the_signals_that_are_its_own() {
    use {ByteOrder::*, CanNumber::*};
    let device = CanDevice {
        interface: "can0".into(),
        signals: vec![
            signal(0, 16, Little, Unsigned),
            CanSignal { id: 0x18ff_0001, ..signal(0, 8, Little, Signed) },
        ],
    };
    let channels = vec![Channel::plain(0, 1e-3), Channel::plain(2, 1.0)];
    let (mut feed, inbox) = connect("can0".into(), channels, Arc::default(), Ended::default());
    device.take(0x123, &[0x10, 0x27], &mut feed);
    device.take(0x18ff_0001, &[0xff], &mut feed); // the same number with 11 bits
    device.take(0x18ff_0001 | libc::CAN_EFF_FLAG, &[0xff], &mut feed);
    device.take(0x123, &[0x10], &mut feed);
    let said: Vec<_> =
        inbox.queue.try_iter().map(|update| (update.which, update.values[0], update.values[2])).collect();
    assert_eq!((said[0].0, said[0].1), (1, 10.0));
    assert_eq!((said[1].0, said[1].2, said.len()), (4, -1.0, 2));
    let garbage = inbox.counters.all().into_iter().find(|(name, _)| *name == "garbage").unwrap().1;
    assert_eq!(garbage, 1, "a frame that is too short is told");
}

/// On a machine with a vcan interface a frame goes through the kernel; where the kernel has no CAN, or no right to make an
/// interface, the sensor says so and goes on trying.
#[test]
fn a_bus_is_read_or_its_absence_told() {
    let name = "vcansofttwin";
    let ip = |arguments: &[&str]| {
        std::process::Command::new("ip").args(arguments).output().is_ok_and(|done| done.status.success())
    };
    let has_bus = ip(&["link", "add", name, "type", "vcan"]) && ip(&["link", "set", name, "up"]);
    let device = CanDevice {
        interface: name.into(),
        signals: vec![signal(0, 16, ByteOrder::Little, CanNumber::Unsigned)],
    };
    if !has_bus {
        println!("no vcan here: only the refusal is checked");
        let refusal = device.open().expect_err("an interface that is not there");
        let expected = [libc::EAFNOSUPPORT, libc::ENODEV, libc::EPROTONOSUPPORT];
        assert!(refusal.raw_os_error().is_some_and(|code| expected.contains(&code)), "{refusal}");
        return;
    }
    let (mut feed, inbox) =
        connect(name.into(), vec![Channel::plain(0, 1.0)], Arc::default(), Ended::default());
    let (reading, writing) = (device.open().unwrap(), device.open().unwrap());
    // SAFETY: all zeros is a value of this plain structure.
    let mut frame: libc::can_frame = unsafe { zeroed() };
    (frame.can_id, frame.can_dlc, frame.data[0]) = (0x123, 2, 7);
    let size = size_of::<libc::can_frame>();
    // SAFETY: the kernel reads a frame's size from a frame.
    let sent = unsafe { libc::write(writing.as_raw_fd(), (&raw const frame).cast(), size) };
    assert_eq!(sent, size as isize);
    let stopper = std::thread::spawn(move || {
        let update = inbox.queue.recv().unwrap();
        drop(inbox);
        update.values[0]
    });
    device.read(&reading, &mut feed, &mut Backoff::new(MAX_BACKOFF));
    assert_eq!(stopper.join().unwrap(), 7.0);
    assert!(ip(&["link", "del", name]));
}

proptest! {
    /// A number of any width at any place, written bit by bit as the .dbc rules say, is read back.
    #[test]
    fn every_place_is_read_back(value in any::<u64>(), bits in 1u8..=64, start in 0u8..64, big in any::<bool>(), noise in any::<u64>()) {
        let byte_order = if big { ByteOrder::Big } else { ByteOrder::Little };
        let signal = signal(start, bits, byte_order, CanNumber::Unsigned);
        let mask = u64::MAX >> (64 - u32::from(bits));
        let mut data = noise.to_le_bytes();
        // Big: from the highest bit on, down within a byte, then to bit 7 of the next one.
        let mut place = usize::from(start);
        for step in 0..u32::from(bits) {
            prop_assume!(place < 64);
            let bit = if big { u32::from(bits) - 1 - step } else { step };
            let set = (value >> bit & 1) as u8;
            data[place / 8] = data[place / 8] & !(1 << (place % 8)) | set << (place % 8);
            place = match (big, place % 8) { (false, _) => place + 1, (true, 0) => place + 15, (true, _) => place - 1 };
        }
        prop_assert_eq!(signal.decode(&data), Some((value & mask) as f64));
    }
}
