//! Tests of `src/layout/requests.rs` that need its private parts.

use super::*;

#[test]
fn every_refusal_has_its_sentence_with_its_number() {
    for status in QueryStatus::ALL {
        assert_eq!(QueryStatus::from_code(status.code()), Some(*status));
        let answer = Answer { status: status.code(), limit: 12.5, ..Answer::default() };
        let text = answer.refusal();
        assert_eq!(text.is_none(), *status == QueryStatus::Answered);
        let named = text.as_ref().is_some_and(|text| text.contains("12.5"));
        assert_eq!(named, status.as_str().contains("{limit}"), "{text:?}");
    }
    let foreign = Answer { status: 999, ..Answer::default() };
    assert!(foreign.refusal().is_some_and(|text| text.contains("999")));
}
