//! Tests of `src/source/modbus.rs` that need its private parts: registers and numbers.

use super::*;
use proptest::prelude::*;

fn at(encoding: Encoding, word_order: WordOrder) -> RegisterAt {
    RegisterAt { unit_id: 1, register: 0, table: Table::Input, encoding, word_order }
}

#[test]
fn registers_are_decoded_in_every_encoding_and_order() {
    let raw = |encoding, order, registers: &[u16]| at(encoding, order).raw(registers);
    assert_eq!(raw(Encoding::U16, WordOrder::Big, &[0xfffe]), Some(65534.0));
    assert_eq!(raw(Encoding::I16, WordOrder::Big, &[0xfffe]), Some(-2.0));
    assert_eq!(raw(Encoding::U32, WordOrder::Big, &[1, 2]), Some(65538.0));
    assert_eq!(raw(Encoding::U32, WordOrder::Little, &[1, 2]), Some(131_073.0));
    assert_eq!(raw(Encoding::I32, WordOrder::Big, &[0xffff, 0xffff]), Some(-1.0));
    let bits = 0.0375f32.to_bits();
    let (high, low) = ((bits >> 16) as u16, bits as u16);
    assert_eq!(raw(Encoding::F32, WordOrder::Little, &[low, high]), Some(f64::from(0.0375f32)));
    assert_eq!(raw(Encoding::F32, WordOrder::Big, &[low]), None, "one register is not an f32");
    assert_eq!(at(Encoding::U16, WordOrder::Big).encode(65536.0), None, "beyond the register");
    assert_eq!(at(Encoding::I32, WordOrder::Little).encode(-1.6), Some(vec![0xfffe, 0xffff]));
}

#[test]
fn wrong_unit_and_register_are_both_reported() {
    let bad = RegisterAt { unit_id: 0, register: u16::MAX, ..at(Encoding::F32, WordOrder::Big) };
    let mut problems = Vec::new();
    bad.problems("values.gap_mm.from", &mut problems);
    assert_eq!(problems.len(), 2, "{problems:#?}");
}

proptest! {
    /// Any reply of a device gives a number or nothing, and numbers are written and read without change.
    #[test]
    fn any_registers_are_answered(
        registers in prop::collection::vec(any::<u16>(), 0..6), which in 0usize..5, little in any::<bool>()
    ) {
        let encoding = [Encoding::U16, Encoding::I16, Encoding::U32, Encoding::I32, Encoding::F32][which];
        let at = at(encoding, if little { WordOrder::Little } else { WordOrder::Big });
        let found = at.raw(&registers);
        prop_assert_eq!(found.is_some(), registers.len() == usize::from(at.count()));
        if let Some(raw) = found.filter(|raw| raw.is_finite()) {
            prop_assert_eq!(at.encode(raw), Some(registers));
        }
    }
}
