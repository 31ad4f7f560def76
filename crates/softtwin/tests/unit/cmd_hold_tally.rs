use super::*;

#[test]
fn mean_of_the_last_quarter() {
    assert_eq!(last_quarter(&[]), None);
    assert_eq!(last_quarter(&[1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 5.0, 7.0]), Some(6.0));
}
