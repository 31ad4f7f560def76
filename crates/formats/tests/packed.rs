//! Packed snapshots: the bound holds, damage is found, nothing panics.

use formats::packed::{Snapshots, Stored, pack, unpack};
use proptest::prelude::*;

const NODES: usize = 400;
const FIELDS: [Stored; 5] =
    [Stored::Steps(2e-3), Stored::Steps(2e-3), Stored::Steps(2e-3), Stored::Distance, Stored::Steps(2e-5)];

fn mesh() -> Vec<[f64; 3]> {
    (0..NODES).map(|n| [n as f64 * 0.3, 2.0, (n % 7) as f64]).collect()
}

/// A bending family: smooth in the parameter, with a kink, as contact has.
fn bending(cases: usize) -> Snapshots {
    let mut values = Vec::new();
    for c in 0..cases {
        let p = c as f64 / cases as f64;
        for x in mesh() {
            let kink = (p - 0.5).max(0.0) * (x[0] / 40.0).sin();
            let y =
                [x[0] * (1.0 - 0.2 * p * p), x[1] - 0.01 * p * x[0] * x[0] + kink, x[2] * (1.0 + 0.1 * p)];
            let u = (0..3).map(|k| (y[k] - x[k]).powi(2)).sum::<f64>().sqrt();
            values.extend(y.map(|v| v as f32));
            values.extend([u as f32, (0.3 * p + kink.abs() * 0.1) as f32]);
        }
    }
    Snapshots { shape: [cases, NODES, 5], values }
}

#[test]
fn every_value_keeps_its_bound_and_the_file_is_small() {
    let original = bending(30);
    let bytes = pack(&original, &FIELDS).unwrap();
    let back = unpack(&bytes, Some(&mesh())).unwrap();
    assert_eq!(back.shape, original.shape);
    // f32 itself rounds by 4e-6 at 100 mm; the error of a distance of three rounded coordinates is at most sqrt(3) times theirs.
    let bounds = [1.01e-3, 1.01e-3, 1.01e-3, 1.75e-3, 1.01e-5];
    for (i, (a, b)) in original.values.iter().zip(&back.values).enumerate() {
        assert!((a - b).abs() <= bounds[i % 5], "value {i}: {a} became {b}");
    }
    assert!(bytes.len() * 5 < original.values.len() * 4, "{} bytes", bytes.len());
}

#[test]
fn packing_twice_changes_nothing_more() {
    let once = unpack(&pack(&bending(5), &FIELDS).unwrap(), Some(&mesh())).unwrap();
    let twice = unpack(&pack(&once, &FIELDS).unwrap(), Some(&mesh())).unwrap();
    assert_eq!(once, twice);
}

#[test]
fn unpackable_data_is_refused() {
    let mut broken = bending(2);
    broken.values[7] = f32::NAN;
    assert_eq!(pack(&broken, &FIELDS).unwrap_err().place, "case 0, field 2");
    broken.values[7] = 1e9;
    assert_eq!(pack(&broken, &FIELDS).unwrap_err().found, "1000000000");
    assert!(pack(&bending(2), &FIELDS[..4]).is_err());
    let bytes = pack(&bending(2), &FIELDS).unwrap();
    assert_eq!(unpack(&bytes, None).unwrap_err().place, "mesh");
    assert!(unpack(&bytes, Some(&mesh()[1..])).is_err());
    assert!(unpack(&[], None).is_err());
}

/// The file's own checksum, so that damage behind it is tested too.
fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
    let body = bytes.len().saturating_sub(8);
    let sum = bytes[..body]
        .iter()
        .fold(0xcbf2_9ce4_8422_2325_u64, |s, b| (s ^ u64::from(*b)).wrapping_mul(0x0100_0000_01b3));
    bytes.truncate(body);
    bytes.extend(sum.to_le_bytes());
    bytes
}

#[test]
fn only_the_current_versions_are_read() {
    let shares = [Stored::Share(1e-4); 5];
    for (fields, version) in [(&FIELDS, 3), (&shares, 4)] {
        let mut bytes = pack(&bending(3), fields).unwrap();
        assert_eq!(bytes[8], version);
        bytes[8] -= 2;
        assert!(unpack(&sealed(bytes), Some(&mesh())).is_err());
    }
}

#[test]
fn a_small_file_that_announces_a_huge_one_is_refused() {
    for at in [12, 20, 28] {
        let mut bytes = pack(&bending(2), &FIELDS).unwrap();
        bytes[at..at + 8].copy_from_slice(&(u64::MAX / 3).to_le_bytes());
        assert_eq!(unpack(&sealed(bytes), Some(&mesh())).unwrap_err().place, "shape");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn a_flipped_bit_or_a_cut_is_found(at in any::<prop::sample::Index>(), bit in 0..8_u8, cut in any::<bool>()) {
        let mut bytes = pack(&bending(2), &FIELDS).unwrap();
        let at = at.index(bytes.len());
        if cut { bytes.truncate(at) } else { bytes[at] ^= 1 << bit }
        prop_assert!(unpack(&bytes, Some(&mesh())).is_err());
    }

    #[test]
    fn damage_behind_a_right_checksum_never_panics(
        flips in prop::collection::vec((any::<prop::sample::Index>(), 0..8_u8), 1..4)
    ) {
        let mut bytes = pack(&bending(2), &FIELDS).unwrap();
        for (at, bit) in flips {
            let at = at.index(bytes.len());
            bytes[at] ^= 1 << bit;
        }
        if let Ok(snapshots) = unpack(&sealed(bytes), Some(&mesh())) {
            let [cases, nodes, fields] = snapshots.shape;
            prop_assert_eq!(snapshots.values.len(), cases * nodes * fields);
        }
    }
}
