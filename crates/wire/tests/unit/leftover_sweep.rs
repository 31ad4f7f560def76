//! Tests of `src/leftover/sweep.rs` that need its private parts.

use super::*;

#[test]
fn a_file_is_in_use_while_it_is_open_and_while_it_is_mapped() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    let file = File::create_new(&path).unwrap();
    file.set_len(4096).unwrap();
    assert!(is_in_use(&path) && !remove_unused(&path), "open");
    // SAFETY: a private mapping of a file that this test owns, unmapped below.
    let map = unsafe {
        libc::mmap(std::ptr::null_mut(), 4096, libc::PROT_READ, libc::MAP_SHARED, file.as_raw_fd(), 0)
    };
    assert_ne!(map, libc::MAP_FAILED);
    drop(file);
    assert!(is_in_use(&path) && !remove_unused(&path), "mapped");
    // SAFETY: the mapping made above.
    assert_eq!(unsafe { libc::munmap(map, 4096) }, 0);
    assert!(!is_in_use(&path) && remove_unused(&path), "neither");
    assert!(!path.exists() && !is_in_use(&path));
}

#[test]
fn a_socket_is_in_use_while_it_is_bound() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("socket");
    let socket = UnixDatagram::bind(&path).unwrap();
    assert!(!remove_unused(&path));
    drop(socket);
    assert!(remove_unused(&path) && !path.exists());
}

#[test]
fn a_newer_file_of_the_same_name_is_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    let old = File::create(&path).unwrap();
    assert!(names_this_file(&path, &old));
    std::fs::rename(&path, folder.path().join("old")).unwrap();
    File::create(&path).unwrap();
    assert!(!names_this_file(&path, &old));
}
