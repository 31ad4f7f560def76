//! Tests of `src/hub.rs`.

use super::*;

#[test]
fn slow_client_gets_only_the_newest_frame_of_each_actuator() {
    let hub = Hub::default();
    for k in 0..100_u8 {
        hub.put(if k % 2 == 0 { "left" } else { "right" }, vec![k]);
    }
    let frames = hub.newer_than(0);
    assert_eq!(frames.iter().map(|f| f.message[0]).collect::<Vec<_>>(), [98, 99]);
    assert!(hub.newer_than(frames[1].number).is_empty());
    hub.put("left", vec![100]);
    assert_eq!(hub.newer_than(frames[1].number).len(), 1);
}

#[test]
fn clients_are_counted_and_limited() {
    let hub = Hub::default();
    let pages: Vec<_> = (0..MAX_VIEWERS).map(|_| hub.enter().expect("below the limit")).collect();
    assert!(hub.enter().is_none());
    drop(pages);
    assert_eq!(hub.viewers(), 0);
}
