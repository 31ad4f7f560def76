//! Tests of `src/ros/parameter_services.rs` that need its private parts.

use super::*;
use crate::ros::golden::bytes as golden;

fn parameters() -> Vec<Parameter> {
    let one = |name: &str, value, description: &str, range| Parameter {
        name: name.into(),
        value,
        description: description.into(),
        range,
    };
    let inputs = vec!["pressure_mpa".to_owned(), "gap_mm".to_owned()];
    vec![
        one("version", Value::Text("1.2".into()), "of what runs", None),
        one("finger.inputs", Value::Texts(inputs), "", None),
        one("finger.input.pressure_mpa", Value::Double(0.045), "measured", Some([0.0, 0.09])),
        one("finger.range.pressure_mpa", Value::Doubles(vec![0.0, 0.09]), "", None),
    ]
}

const NAMES: &str = include_str!("../golden/names_request.hex");

#[test]
fn values_are_those_of_another_writer() {
    let found = Access::Get.answer(&golden(NAMES), &parameters()).unwrap();
    assert_eq!(found, golden(include_str!("../golden/values.hex")));
}

#[test]
fn types_are_those_of_another_writer() {
    let found = Access::Types.answer(&golden(NAMES), &parameters()).unwrap();
    assert_eq!(found, golden(include_str!("../golden/types.hex")));
}

#[test]
fn descriptors_are_those_of_another_writer() {
    let found = Access::Describe.answer(&golden(NAMES), &parameters()).unwrap();
    assert_eq!(found, golden(include_str!("../golden/descriptors.hex")));
}

#[test]
fn names_are_listed_by_prefix_and_depth() {
    let found =
        Access::List.answer(&golden(include_str!("../golden/list_request.hex")), &parameters()).unwrap();
    assert_eq!(found, golden(include_str!("../golden/listed.hex")));
    let listed = |prefixes: &[&str], depth| {
        let bytes = list(&parameters(), prefixes, depth);
        let mut reader = Reader::new(&bytes).unwrap();
        let texts = |found: Vec<&str>| found.join(" ");
        (texts(reader.texts(9).unwrap()), texts(reader.texts(9).unwrap()))
    };
    assert_eq!(listed(&[], 1), ("version".into(), String::new()));
    assert_eq!(listed(&[], 2), ("version finger.inputs".into(), "finger".into()));
    assert_eq!(listed(&["finger"], 1), ("finger.inputs".into(), "finger".into()));
    assert_eq!(listed(&["fing"], 0), (String::new(), String::new()));
    assert_eq!(listed(&["version"], 1), ("version".into(), String::new()));
}

#[test]
fn setting_is_refused_with_the_reason() {
    let request = golden(include_str!("../golden/set_request.hex"));
    let found = Access::Set.answer(&request, &[]).unwrap();
    assert_eq!(found, golden(include_str!("../golden/set.hex")));
    let found = Access::SetAtomically.answer(&request, &[]).unwrap();
    assert_eq!(found, golden(include_str!("../golden/set_atomically.hex")));
}

#[test]
fn a_request_that_ends_too_soon_is_refused_wherever_it_ends() {
    for (access, request) in [
        (Access::List, include_str!("../golden/list_request.hex")),
        (Access::Get, NAMES),
        (Access::Set, include_str!("../golden/set_request.hex")),
        (Access::SetAtomically, include_str!("../golden/set_request.hex")),
    ] {
        let whole = golden(request);
        for length in 0..whole.len() {
            assert!(access.answer(&whole[..length], &parameters()).is_err(), "{access:?}: {length} bytes");
        }
    }
}

#[test]
fn counts_that_cannot_be_are_refused() {
    for count in [1001, u32::MAX] {
        let request = Cdr::new().word(count).finish();
        for access in Access::ALL {
            let refused = access.answer(&request, &[]).unwrap_err();
            assert!(refused.contains("at most 1000 names"), "{refused}");
        }
    }
    // A list inside a value that says to be longer than memory.
    let begin =
        || Cdr::new().word(1).text("a").byte(0).byte(0).long(0).doubles(&[0.0]).text("").word(0).word(0);
    assert!(set_request(&begin().word(u32::MAX).finish()).is_none());
    assert_eq!(set_request(&begin().word(0).word(0).word(0).finish()), Some(1));
}
