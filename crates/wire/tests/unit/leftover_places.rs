//! Tests of `src/leftover/places.rs` that need its private parts.

use super::*;
use crate::Domain;

#[test]
fn a_domain_owns_its_own_segments_only() {
    let digits = "9204dd183d1c4d8e1ff592a30766ffa6765aa8b5";
    let places = Domain::named("a").places().unwrap();
    let (user, prefix) = (uid(), &places.prefix);
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

/// By a hard link a stranger gives a file of this user the name of its folder.
#[test]
fn a_file_in_the_place_of_the_own_folder_is_passed_over() {
    let parent = tempfile::tempdir().unwrap();
    std::fs::write(parent.path().join("mine"), "").unwrap();
    std::os::unix::fs::symlink("/", parent.path().join("mine-1")).unwrap();
    let made = own_folder(parent.path(), "mine").unwrap();
    assert_eq!(made, parent.path().join("mine-2"));
    assert_eq!(std::fs::metadata(&made).unwrap().mode() & 0o777, 0o700);
    std::fs::remove_file(parent.path().join("mine")).unwrap();
    assert_eq!(own_folder(parent.path(), "mine").unwrap(), made, "programs find the same folder again");
}

#[test]
fn a_folder_that_cannot_be_made_is_an_error() {
    assert_eq!(own_folder(Path::new("/proc/self/fdinfo"), "mine").unwrap_err().kind(), ErrorKind::NotFound);
}
