//! The text of a report.

use super::{number, text};
use serde::Serialize;

#[derive(Serialize)]
struct Case {
    name: &'static str,
    force_n: Option<f64>,
}

#[derive(Serialize)]
struct Found {
    title: &'static str,
    remarks: Vec<&'static str>,
    pressure_mpa: f64,
    is_inside: bool,
    coefficients: Vec<f64>,
    largest: Case,
    cases: Vec<Case>,
}

#[test]
fn text_has_title_list_section_table_and_remarks_in_this_order() {
    let case = |name, force_n| Case { name, force_n };
    let found = Found {
        title: "model finger",
        remarks: vec!["One state is outside."],
        pressure_mpa: 0.05,
        is_inside: true,
        coefficients: vec![0.0; 20],
        largest: case("b", Some(2.0)),
        cases: vec![case("a", None), case("bc", Some(12.3456))],
    };
    let expected = "\
model finger
pressure [MPa]  0.05
is inside       yes
coefficients    20 values

largest
  name       b
  force [N]  2

cases
  name  force [N]
  a             -
  bc        12.35

One state is outside.";
    assert_eq!(text(&found).expect("text"), expected);
}

#[test]
fn a_number_keeps_four_significant_digits() {
    let cases = [
        (0.0, "0"),
        (-0.0, "-0"),
        (1.0, "1"),
        (0.1 + 0.2, "0.3"),
        (0.001_234_56, "0.001235"),
        (0.999_99, "1"),
        (12_345.6, "12346"),
        (1e9, "1.000e9"),
        (-1e-6, "-1.000e-6"),
    ];
    for (value, expected) in cases {
        assert_eq!(number(value), expected);
    }
}
