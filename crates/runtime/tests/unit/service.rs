use super::*;

#[test]
fn signals_within_a_second_of_the_first_are_one_request() {
    let first_ms = AtomicU64::new(0);
    let decided = [0, 0, 900, 1_002, 5_000].map(|now_ms| at_signal(&first_ms, now_ms));
    use AtSignal::{EndAtOnce, Nothing, Stop};
    assert_eq!(decided, [Stop, Nothing, Nothing, EndAtOnce, EndAtOnce]);
}
