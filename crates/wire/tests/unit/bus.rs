//! Tests of `src/bus.rs` that need its private parts.

use super::*;

/// A stranger takes the counter's name after it was found free. Takes root, which may give a file away.
#[test]
fn a_name_that_was_taken_since_the_look_is_passed_over() {
    let domain = Domain::isolated("late");
    drop(Bus::open(&domain).unwrap());
    let places = domain.places().unwrap();
    let [counter] = places.counter_segments().try_into().unwrap();
    if std::os::unix::fs::chown(&counter, Some(54_321), None).is_err() {
        std::fs::remove_file(&counter).unwrap();
        return;
    }
    for mode in [0o600, 0o666] {
        std::fs::set_permissions(&counter, std::os::unix::fs::PermissionsExt::from_mode(mode)).unwrap();
        assert!(matches!(Bus::join(&domain, &places), Err(WireError::Node { .. })), "{mode:o}");
    }
    let bus = Bus::open(&domain).unwrap();
    assert_eq!(bus.places.prefix, places.prefix.replacen(&format!("u{}_", crate::sys::uid()), "u0-1_", 1));
    drop(bus);
    std::fs::remove_file(&counter).unwrap();
    domain.remove_leftovers().unwrap();
}
