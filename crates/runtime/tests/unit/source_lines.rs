//! Tests of `src/source/lines.rs` that need its private parts.

use super::*;
use proptest::prelude::*;

fn cells(line: &str, comma_separates: bool) -> Result<Option<Vec<Option<f64>>>, LineError> {
    Ok(match parse_cells(line.as_bytes(), comma_separates)? {
        Some(Cells::Numbers(numbers)) => Some(numbers.into_iter().collect::<Result<_, _>>()?),
        Some(Cells::Json(_)) | None => None,
    })
}

fn numbers(line: &str) -> Vec<f64> {
    cells(line, false).unwrap().unwrap().into_iter().map(|cell| cell.unwrap_or(f64::NEG_INFINITY)).collect()
}

#[test]
fn lines_are_split_into_numbers_or_read_as_json() {
    assert_eq!(numbers(" 0.0312 \r"), [0.0312]);
    assert_eq!(numbers("0.03,40"), [0.03, 40.0]);
    assert_eq!(numbers("0.03; 40; 0.5"), [0.03, 40.0, 0.5]);
    assert_eq!(cells("0.03,", true), Ok(Some(vec![Some(0.03), None])));
    assert!(numbers("nan")[0].is_nan(), "passed on; the twin validates it");
    let json = parse_cells(br#"{"pressure": 0.03, "serial": "A7"}"#, false);
    assert!(matches!(json, Ok(Some(Cells::Json(object))) if object.len() == 2));
    assert_eq!(cells("# started", true), Ok(None));
    assert_eq!(cells("ERR 7", true), Err(LineError::NotANumber { found: "ERR".into() }));
    assert_eq!(numbers("+014.70 +025.00  000.00"), [14.7, 25.0, 0.0]);
    assert_eq!(cells("\t30.25\t5", false), Ok(Some(vec![None, Some(30.25), Some(5.0)])));
    let Ok(Some(Cells::Numbers(mixed))) = parse_cells(b"A;14.7;OK", false) else { panic!("cells") };
    assert!(mixed[0].is_err() && mixed[1] == Ok(Some(14.7)) && mixed[2].is_err());
    assert_eq!(parse_cells(b"\xff\xfe", true), Err(LineError::NotText));
    assert!(matches!(parse_cells(b"{\"gap\": }", true), Err(LineError::Json { .. })));
}

#[test]
fn decimal_comma_is_not_taken_for_a_separator() {
    for line in ["0,031", "0,031;40,2", "0,031; 40.5", "0,031, 40.5", "0,031\t40", "30,40"] {
        assert_eq!(cells(line, false), Err(LineError::Comma { found: line.into() }), "{line}");
    }
    assert_eq!(numbers("0.031,40,5"), [0.031, 40.0, 5.0]);
    assert_eq!(numbers("0, 40"), [0.0, 40.0]);
    assert_eq!(numbers("0;40"), [0.0, 40.0]);
    assert_eq!(cells("30,40", true), Ok(Some(vec![Some(30.0), Some(40.0)])), "as the scene specifies");
}

#[test]
fn line_without_end_has_bounded_memory_and_is_one_error() {
    let mut buffer = LineBuffer::default();
    let mut found = Vec::new();
    for _ in 0..1_000 {
        buffer.split(&[b'1'; 1_000], |line| found.push(parse_cells(line, false)));
    }
    assert!(found == [Err(LineError::TooLong)], "reported before its end");
    assert!(buffer.line.capacity() < 4 * MAX_LINE_BYTES);
    buffer.split(b"\n0.5\n", |line| found.push(parse_cells(line, false)));
    assert_eq!(found, [Err(LineError::TooLong), Ok(Some(Cells::Numbers(vec![Ok(Some(0.5))])))]);
}

proptest! {
    /// However the bytes are cut into pieces, the lines are the same.
    #[test]
    fn lines_do_not_depend_on_the_pieces(values in prop::collection::vec(-1e3f64..1e3, 1..20), piece in 1usize..9) {
        let text: String = values.iter().map(|value| format!("{value}\r\n")).collect();
        let (mut buffer, mut found) = (LineBuffer::default(), Vec::new());
        for part in text.as_bytes().chunks(piece) {
            buffer.split(part, |line| found.push(parse_cells(line, false).unwrap().unwrap()));
        }
        let expected: Vec<Cells> = values.iter().map(|value| Cells::Numbers(vec![Ok(Some(*value))])).collect();
        prop_assert_eq!(found, expected);
    }

    #[test]
    fn any_bytes_are_answered(bytes in prop::collection::vec(any::<u8>(), 0..700)) {
        let mut buffer = LineBuffer::default();
        buffer.split(&bytes, |line| drop(parse_cells(line, false)));
        prop_assert!(buffer.line.len() <= MAX_LINE_BYTES + 1);
    }
}
