//! Tests of `src/domain.rs` that need its private parts.

use super::*;

#[test]
fn folder_and_prefix_are_limited_by_the_path_of_a_socket() {
    let own = format!("u{}_", uid()).len();
    let domain = |root: usize, name: usize| {
        Domain::of(Some(&"n".repeat(name.saturating_sub(own))), Some(format!("/{}", "r".repeat(root - 1))))
    };
    // `iox2_<name>_` is 6 bytes longer than the name.
    assert!(domain(20, 35).places().is_ok());
    let long = domain(21, 35).places().unwrap_err();
    assert!(matches!(long, WireError::LongDomain { found: 62, allowed: 61, .. }), "{long}");
    for (root, name) in [(160, 4), (64, 4), (13, 150), (255, 255), (5000, 5000)] {
        assert!(matches!(domain(root, name).places(), Err(WireError::LongDomain { .. })), "{root} {name}");
    }
    assert!(matches!(Domain::named(&"n".repeat(150)).places(), Err(WireError::LongDomain { .. })));
}

#[test]
fn isolated_domains_stay_short() {
    let longest = Domain::isolated("label of 14 ch").prefix;
    assert!(longest.len() + own_root().unwrap().len() <= MAX_NAME_BYTES, "{longest}");
}
