//! Tests of `src/message/field.rs` that need its private parts.

use super::*;

#[test]
fn values_come_back_to_the_bit() {
    for numbers in [vec![], vec![1.5_f32], vec![0.1, -2.0], vec![f32::MIN_POSITIVE, 3.0e8, -0.0]] {
        let header = FieldHeader::default();
        let message = FieldMessage::new(&header, &numbers);
        let value = serde_json::to_value(message).expect("numbers and strings");
        let back = values(value["values"].as_str().expect("text")).expect("our own text");
        assert_eq!(
            back.iter().map(|v| v.to_bits()).collect::<Vec<_>>(),
            numbers.iter().map(|v| v.to_bits()).collect::<Vec<_>>()
        );
    }
    assert_eq!(values("AADAPw"), Some(vec![1.5]), "padding may be missing");
    assert_eq!(values("!!!!"), None);
    assert_eq!(values("Zm9v"), None, "three bytes");
}
