//! Tests of `src/source/sensor/lines.rs` that need its private parts.

use super::*;
use proptest::prelude::*;

fn numbers(line: &str) -> [f64; 3] {
    parse_line(line.as_bytes(), false).unwrap().unwrap()
}

#[test]
fn what_a_gauge_sends() {
    assert_eq!(numbers(" 0.0312 \r")[0], 0.0312);
    assert_eq!(numbers("0.03,40")[..2], [0.03, 40.0]);
    assert_eq!(numbers("0.03; 40; 0.5"), [0.03, 40.0, 0.5]);
    assert_eq!(numbers(r#"{"pressure_mpa": 0.03, "gap": 40, "serial": "A7"}"#)[..2], [0.03, 40.0]);
    assert!(numbers("nan")[0].is_nan(), "nan is passed on; the twin validates it");
    assert_eq!(parse_line(b"# started", true), Ok(None));
    assert_eq!(parse_line(b"0,1,2,3", true), Err(LineError::TooMany { found: 4 }));
    assert_eq!(parse_line(b"0.03,", true), Err(LineError::NotANumber { found: String::new() }));
    assert_eq!(parse_line(b"ERR 7", true), Err(LineError::NotANumber { found: "ERR 7".into() }));
    assert_eq!(parse_line(b"\xff\xfe", true), Err(LineError::NotText));
    assert!(matches!(parse_line(br#"{"gap": 40}"#, true), Err(LineError::Json { .. })));
}

#[test]
fn a_decimal_comma_is_not_taken_for_a_separator() {
    for line in ["0,031", "0,031;40,2", "0,031; 40.5", "0,031, 40.5", "0,031\t40", "30,40"] {
        let found = parse_line(line.as_bytes(), false);
        assert_eq!(found, Err(LineError::Comma { found: line.into() }), "{line}");
    }
    assert_eq!(numbers("0.031,40,5"), [0.031, 40.0, 5.0]);
    assert_eq!(numbers("0, 40")[..2], [0.0, 40.0]);
    assert_eq!(numbers("0;40")[..2], [0.0, 40.0]);
    let said = parse_line(b"30,40", true).unwrap().unwrap();
    assert_eq!(said[..2], [30.0, 40.0], "the scene says that a comma separates");
}

#[test]
fn a_line_without_end_costs_no_memory_and_one_error() {
    let mut buffer = LineBuffer::default();
    let mut found = Vec::new();
    for _ in 0..1_000 {
        buffer.push(&[b'1'; 1_000], |line| found.push(line));
    }
    assert!(found.is_empty() && buffer.line.capacity() < 4 * MAX_LINE_BYTES);
    buffer.push(b"\n0.5\n", |line| found.push(line));
    assert_eq!(found.len(), 2);
    assert_eq!(found[0], Err(LineError::TooLong));
    assert_eq!(found[1].as_ref().unwrap().unwrap()[0], 0.5);
}

proptest! {
    /// However the bytes are cut into pieces, the lines are the same.
    #[test]
    fn pieces_do_not_matter(values in prop::collection::vec(-1e3f64..1e3, 1..20), piece in 1usize..9) {
        let text: String = values.iter().map(|value| format!("{value}\r\n")).collect();
        let (mut buffer, mut found) = (LineBuffer::default(), Vec::new());
        for part in text.as_bytes().chunks(piece) {
            buffer.push(part, |line| found.push(line.unwrap().unwrap()[0]));
        }
        prop_assert_eq!(found, values);
    }

    #[test]
    fn any_bytes_are_answered(bytes in prop::collection::vec(any::<u8>(), 0..700)) {
        let mut buffer = LineBuffer::default();
        buffer.push(&bytes, |_| {});
        prop_assert!(buffer.line.len() <= MAX_LINE_BYTES + 1);
    }
}
