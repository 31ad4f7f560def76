//! Tests of `src/leftover/claim.rs`.

use super::*;

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
