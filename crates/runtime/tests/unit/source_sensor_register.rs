//! Tests of `src/source/sensor/register.rs` that need its private parts.

use super::*;
use proptest::prelude::*;

fn spec(encoding: Encoding, word_order: WordOrder) -> RegisterSpec {
    RegisterSpec {
        unit_id: 1,
        register: 0,
        table: Table::Input,
        encoding,
        word_order,
        scale: 1.0,
        offset: 0.0,
        unit: None,
    }
}

#[test]
fn every_encoding_and_order() {
    let value =
        |encoding, order, registers: &[u16]| spec(encoding, order).decode(Quantity::Pressure, registers);
    assert_eq!(value(Encoding::U16, WordOrder::Big, &[0xfffe]), Some(65534.0));
    assert_eq!(value(Encoding::I16, WordOrder::Big, &[0xfffe]), Some(-2.0));
    assert_eq!(value(Encoding::U32, WordOrder::Big, &[1, 2]), Some(65538.0));
    assert_eq!(value(Encoding::U32, WordOrder::Little, &[1, 2]), Some(131_073.0));
    assert_eq!(value(Encoding::I32, WordOrder::Big, &[0xffff, 0xffff]), Some(-1.0));
    let bits = 0.0375f32.to_bits();
    let (high, low) = ((bits >> 16) as u16, bits as u16);
    assert_eq!(value(Encoding::F32, WordOrder::Little, &[low, high]), Some(f64::from(0.0375f32)));
    assert_eq!(value(Encoding::F32, WordOrder::Big, &[low]), None, "one register is no f32");
}

#[test]
fn scale_offset_and_unit_are_applied_in_this_order() {
    let gauge = RegisterSpec {
        scale: 0.1,
        offset: -5.0,
        unit: Some("kPa".into()),
        ..spec(Encoding::I16, WordOrder::Big)
    };
    let pressure_mpa = gauge.decode(Quantity::Pressure, &[450]).unwrap();
    assert!((pressure_mpa - 0.040).abs() < 1e-15, "{pressure_mpa}: (450 x 0.1 - 5) kPa");
    for (unit, mpa) in [("bar", 0.1), ("psi", 0.006894757293168), ("Pa", 1e-6), ("mbar", 1e-4)] {
        assert_eq!(Quantity::Pressure.factor(Some(unit)), Some(mpa));
    }
}

#[test]
fn all_problems_at_once() {
    let bad = RegisterSpec {
        unit_id: 0,
        register: u16::MAX,
        scale: 0.0,
        offset: f64::NAN,
        unit: Some("furlong".into()),
        ..spec(Encoding::F32, WordOrder::Big)
    };
    let mut problems = Vec::new();
    bad.problems("source.gap", Quantity::Gap, &mut problems);
    assert_eq!(problems.len(), 5, "{problems:#?}");
}

proptest! {
    /// Any reply of a device, any configuration: a number or nothing.
    #[test]
    fn any_registers_are_answered(
        registers in prop::collection::vec(any::<u16>(), 0..6), scale in any::<f64>(), which in 0usize..5, little in any::<bool>()
    ) {
        let encoding = [Encoding::U16, Encoding::I16, Encoding::U32, Encoding::I32, Encoding::F32][which];
        let order = if little { WordOrder::Little } else { WordOrder::Big };
        let spec = RegisterSpec { scale, ..spec(encoding, order) };
        let found = spec.decode(Quantity::Force, &registers);
        prop_assert_eq!(found.is_some(), registers.len() == usize::from(spec.count()));
    }
}
