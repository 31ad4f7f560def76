//! `.npy`: bytes NumPy would write, round trips, and files that lie.

use formats::npy::{read_f32, read_f64, write_f32};
use proptest::prelude::*;
use std::path::PathBuf;

fn file(bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.npy");
    std::fs::write(&path, bytes).unwrap();
    (dir, path)
}

/// A file with this header text, padded by hand, and these data bytes.
fn with_header(text: &str, data: &[u8]) -> Vec<u8> {
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((text.len() as u16).to_le_bytes());
    bytes.extend(text.as_bytes());
    bytes.extend(data);
    bytes
}

#[test]
fn written_files_equal_numpys() {
    let (_dir, path) = file(b"");
    write_f32(&path, &[2, 1], &[1.0, -2.5]).unwrap();
    let mut golden =
        b"\x93NUMPY\x01\x00\x76\x00{'descr': '<f4', 'fortran_order': False, 'shape': (2, 1), }".to_vec();
    golden.resize(127, b' ');
    golden.push(b'\n');
    golden.extend(b"\x00\x00\x80\x3f\x00\x00\x20\xc0");
    assert_eq!(std::fs::read(&path).unwrap(), golden);
}

#[test]
fn reads_doubles_as_both_types() {
    let mut data = 0.1_f64.to_le_bytes().to_vec();
    data.extend(2.0_f64.to_le_bytes());
    let (_dir, path) =
        file(&with_header("{'descr': '<f8', 'fortran_order': False, 'shape': (2,), }\n", &data));
    assert_eq!(read_f64(&path).unwrap().data, [0.1, 2.0]);
    assert_eq!(read_f32(&path).unwrap().data, [0.1_f32, 2.0]);
    assert_eq!(read_f32(&path).unwrap().shape, [2]);
}

/// The numbers that NumPy stores for 1, -2 and 3 in each kind.
#[test]
fn reads_every_kind_of_number_and_both_byte_orders() {
    let read = |descr: &str, data: &[u8]| {
        let text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': (3,), }}\n");
        let (_dir, path) = file(&with_header(&text, data));
        let (wide, narrow) = (read_f64(&path).unwrap().data, read_f32(&path).unwrap().data);
        assert_eq!(wide, narrow.iter().map(|v| f64::from(*v)).collect::<Vec<_>>(), "{descr}");
        wide
    };
    macro_rules! check {
        ($t:ty, $name:literal, $values:expr) => {
            let values: [$t; 3] = $values;
            let expected = values.map(|v| v as f64).to_vec();
            let little: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
            let big: Vec<u8> = values.iter().flat_map(|v| v.to_be_bytes()).collect();
            assert_eq!(read(concat!("<", $name), &little), expected);
            assert_eq!(read(concat!(">", $name), &big), expected);
        };
    }
    check!(f64, "f8", [1.0, -2.0, 3.5]);
    check!(f32, "f4", [1.0, -2.0, 3.5]);
    check!(i64, "i8", [1, -2, 3]);
    check!(i32, "i4", [1, -2, 3]);
    check!(i16, "i2", [1, -2, 3]);
    check!(i8, "i1", [1, -2, 3]);
    check!(u64, "u8", [1, 2, 3]);
    check!(u32, "u4", [1, 2, u32::MAX - 255]);
    check!(u16, "u2", [1, 2, u16::MAX]);
    check!(u8, "u1", [1, 2, u8::MAX]);
    assert_eq!(read("|b1", &[1, 0, 1]), [1.0, 0.0, 1.0]);
    // 1, -2 and the smallest number of 16 bits.
    let half = [0x3c00_u16, 0xc000, 1];
    let expected = [1.0, -2.0, 2.0_f64.powi(-24)];
    assert_eq!(read("<f2", &half.map(u16::to_le_bytes).concat()), expected);
    assert_eq!(read(">f2", &half.map(u16::to_be_bytes).concat()), expected);
}

#[test]
fn fortran_order_is_turned_into_c_order() {
    let text = "{'descr': '<f4', 'fortran_order': True, 'shape': (2, 3, 2), }\n";
    // Element (i, j, k) is 100 i + 10 j + k.
    let of = |i: usize, j: usize, k: usize| (100 * i + 10 * j + k) as f32;
    let mut stored = Vec::new();
    for k in 0..2 {
        for j in 0..3 {
            stored.extend((0..2).flat_map(|i| of(i, j, k).to_le_bytes()));
        }
    }
    let (_dir, path) = file(&with_header(text, &stored));
    let array = read_f32(&path).unwrap();
    let expected: Vec<f32> = (0..12).map(|n| of(n / 6, n / 2 % 3, n % 2)).collect();
    assert_eq!((array.shape, array.data), (vec![2, 3, 2], expected));
}

#[test]
fn refuses_headers_that_lie_without_allocating() {
    let lies = [
        ("{'descr': '<f4', 'fortran_order': False, 'shape': (4611686018427387904,), }", "file length"),
        ("{'descr': '<f4', 'fortran_order': False, 'shape': (4294967296, 4294967296, 0), }", "file length"),
        ("{'descr': '<f4', 'fortran_order': False, 'shape': (3,), }", "file length"),
        ("{'descr': '<f4', 'fortran_order': Perhaps, 'shape': (1, 1), }", "fortran_order"),
        ("{'descr': '<f3', 'fortran_order': False, 'shape': (1,), }", "descr"),
        ("{'descr': '<c8', 'fortran_order': False, 'shape': (1,), }", "descr"),
        ("{'descr': '|O', 'fortran_order': False, 'shape': (1,), }", "descr"),
        ("{'descr': '<f4', 'fortran_order': False, 'shape': (-1,), }", "shape"),
        ("{'descr': '<f4', 'fortran_order': False, 'shape': ((((1,)))), }", "shape"),
        ("{'descr': '<f4', 'shape': (1,), }", "header"),
        ("{'descr': '<f4', 'fortran_order': False, 'shape': (1,), 'x': 1}", "header"),
        ("[]", "header"),
    ];
    for (text, place) in lies {
        let (_dir, path) = file(&with_header(text, &[0; 4]));
        let error = read_f32(&path).unwrap_err().to_string();
        assert!(error.contains(&format!("{place}: expected")), "{text}: {error}");
    }
}

#[test]
fn refuses_every_truncation() {
    let (_dir, path) = file(b"");
    write_f32(&path, &[3], &[1.0, 2.0, 3.0]).unwrap();
    let whole = std::fs::read(&path).unwrap();
    for length in 0..whole.len() {
        let (_dir, path) = file(&whole[..length]);
        assert!(read_f32(&path).is_err(), "accepted {length} of {} bytes", whole.len());
    }
}

#[test]
fn a_shape_that_does_not_fit_is_not_written() {
    let (_dir, path) = file(b"");
    let error = write_f32(&path, &[2, 2], &[0.0; 3]).unwrap_err().to_string();
    assert!(error.ends_with("found 3"), "{error}");
}

proptest! {
    #[test]
    fn round_trip(values in proptest::collection::vec(any::<f32>().prop_filter("NaN", |v| !v.is_nan()), 0..200)) {
        let (_dir, path) = file(b"");
        write_f32(&path, &[values.len()], &values).unwrap();
        let back = read_f32(&path).unwrap();
        prop_assert_eq!(back.shape, vec![values.len()]);
        prop_assert_eq!(back.data, values);
    }

    #[test]
    fn random_bytes_never_panic(mut bytes in proptest::collection::vec(any::<u8>(), 0..300), magic: bool) {
        if magic {
            bytes.splice(0..bytes.len().min(8), *b"\x93NUMPY\x01\x00");
        }
        let (_dir, path) = file(&bytes);
        let _ = read_f32(&path);
    }

    #[test]
    fn a_flipped_bit_is_read_or_refused_never_worse(at in 0_usize..140, bit in 0_u8..8) {
        let (_dir, path) = file(b"");
        write_f32(&path, &[3], &[1.0, 2.0, 3.0]).unwrap();
        let mut bytes = std::fs::read(&path).unwrap();
        bytes[at] ^= 1 << bit;
        std::fs::write(&path, &bytes).unwrap();
        if let Ok(array) = read_f32(&path) {
            prop_assert_eq!(array.shape.iter().product::<usize>(), array.data.len());
            prop_assert!(array.data.len() <= 3);
        }
    }
}
