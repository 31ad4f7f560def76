//! Tests of `src/source/modbus.rs` that need its private parts: registers and numbers.

use super::*;
use proptest::prelude::*;

fn at(encoding: Encoding, byte_order: ByteOrder) -> RegisterAt {
    RegisterAt { unit_id: 1, register: 0, table: Table::Input, encoding, byte_order }
}

#[test]
fn registers_are_decoded_in_every_encoding_and_order() {
    let raw = |encoding, order, registers: &[u16]| at(encoding, order).raw(registers);
    assert_eq!(raw(Encoding::U16, ByteOrder::Abcd, &[0xfffe]), Some(65534.0));
    assert_eq!(raw(Encoding::I16, ByteOrder::Abcd, &[0xfffe]), Some(-2.0));
    assert_eq!(raw(Encoding::U32, ByteOrder::Abcd, &[1, 2]), Some(65538.0));
    assert_eq!(raw(Encoding::U32, ByteOrder::Cdab, &[1, 2]), Some(131_073.0));
    assert_eq!(raw(Encoding::I32, ByteOrder::Abcd, &[0xffff, 0xffff]), Some(-1.0));
    let bits = 0.0375f32.to_bits();
    let (high, low) = ((bits >> 16) as u16, bits as u16);
    assert_eq!(raw(Encoding::F32, ByteOrder::Cdab, &[low, high]), Some(f64::from(0.0375f32)));
    assert_eq!(raw(Encoding::F32, ByteOrder::Abcd, &[low]), None, "one register is not an f32");
    assert_eq!(at(Encoding::U16, ByteOrder::Abcd).encode(65536.0), None, "beyond the register");
    assert_eq!(at(Encoding::I32, ByteOrder::Cdab).encode(-1.6), Some(vec![0xfffe, 0xffff]));
}

/// 1.5 and its bytes a to d, and 8 bytes, in the orders that manuals name.
#[test]
fn the_four_byte_orders_are_those_of_the_manuals() {
    let [a, b, c, d] = 1.5e-3f32.to_be_bytes();
    let orders = [
        (ByteOrder::Abcd, [a, b, c, d]),
        (ByteOrder::Badc, [b, a, d, c]),
        (ByteOrder::Cdab, [c, d, a, b]),
        (ByteOrder::Dcba, [d, c, b, a]),
    ];
    for (order, [p, q, r, s]) in orders {
        let registers = [u16::from_be_bytes([p, q]), u16::from_be_bytes([r, s])];
        assert_eq!(at(Encoding::F32, order).raw(&registers), Some(f64::from(1.5e-3f32)), "{order:?}");
    }
    let bytes = 1.5e-3f64.to_be_bytes();
    let words =
        |bytes: [u8; 8]| bytes.as_chunks::<2>().0.iter().map(|b| u16::from_be_bytes(*b)).collect::<Vec<_>>();
    assert_eq!(at(Encoding::F64, ByteOrder::Abcd).raw(&words(bytes)), Some(1.5e-3));
    let mut reversed = bytes;
    reversed.reverse();
    assert_eq!(at(Encoding::F64, ByteOrder::Dcba).raw(&words(reversed)), Some(1.5e-3));
    assert_eq!(at(Encoding::U16, ByteOrder::Badc).raw(&[0x0102]), Some(f64::from(0x0201)));
}

#[test]
fn wrong_unit_and_register_are_both_reported() {
    let bad = RegisterAt { unit_id: 0, register: u16::MAX, ..at(Encoding::F32, ByteOrder::Abcd) };
    let mut problems = Vec::new();
    bad.problems(true, &mut Problems::new(&mut problems, "values.gap_mm.from"));
    assert_eq!(problems.len(), 2, "{problems:#?}");
    bad.problems(false, &mut Problems::new(&mut problems, "values.gap_mm.from"));
    assert_eq!(problems.len(), 3, "on TCP unit 0 is the device itself: {problems:#?}");
}

proptest! {
    /// Any reply of a device gives a number or nothing, and numbers are written and read without change.
    #[test]
    fn any_registers_are_answered(
        registers in prop::collection::vec(any::<u16>(), 0..6), which in 0usize..6, order in 0usize..4
    ) {
        let encoding = [Encoding::U16, Encoding::I16, Encoding::U32, Encoding::I32, Encoding::F32, Encoding::F64][which];
        let at = at(encoding, [ByteOrder::Abcd, ByteOrder::Badc, ByteOrder::Cdab, ByteOrder::Dcba][order]);
        let found = at.raw(&registers);
        prop_assert_eq!(found.is_some(), registers.len() == usize::from(at.count()));
        if let Some(raw) = found.filter(|raw| raw.is_finite()) {
            prop_assert_eq!(at.encode(raw), Some(registers));
        }
    }
}
