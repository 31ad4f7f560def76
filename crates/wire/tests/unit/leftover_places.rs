//! Tests of `src/leftover/places.rs` that need its private parts.

use crate::Domain;

#[test]
fn a_domain_owns_its_own_segments_only() {
    let digits = "9204dd183d1c4d8e1ff592a30766ffa6765aa8b5";
    let places = Domain::named("a").places().unwrap();
    let (user, prefix) = (crate::sys::uid(), &places.prefix);
    assert_eq!(*prefix, format!("iox2_a_u{user}_"));
    assert!(places.owns_segment(&format!("{prefix}{digits}_node.0_10_0.global_mgmt")));
    assert!(places.owns_segment(&format!("{prefix}{digits}_1_2.connection")));
    assert!(!places.owns_segment(&format!("iox2_a_b_u{user}_{digits}_1.data")), "that is domain a_b");
    assert!(!places.owns_segment(&format!("iox2_u{user}_{digits}_1.data")), "that is the default domain");
    assert!(!places.owns_segment(&format!("{prefix}123.data")), "that is not iceoryx2's");
    assert!(
        !places.owns_segment(&format!("{prefix}softtwin_0123456789abcdef.writer")),
        "that is a writer's lock"
    );
}
