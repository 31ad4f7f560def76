//! Tests of `src/machine.rs` that need its private parts.

use super::*;

#[test]
fn the_temporary_folder_has_space_and_a_missing_one_is_an_error() {
    let space = space(&std::env::temp_dir()).unwrap();
    assert!(space.free_bytes <= space.total_bytes && space.total_bytes > 0);
    assert!(is_writable(&std::env::temp_dir()));
    assert!(
        super::space(Path::new("/no/such/folder")).is_err() && !is_writable(Path::new("/no/such/folder"))
    );
}

#[test]
fn shared_memory_is_in_memory_and_proc_is_not() {
    assert!(is_in_memory(Path::new("/dev/shm")).unwrap());
    assert!(!is_in_memory(Path::new("/proc")).unwrap());
    assert!(is_in_memory(Path::new("/no/such/folder")).is_err());
}

/// The kernel's own account of the limits agrees.
#[test]
fn limits_are_those_of_proc() {
    let text = std::fs::read_to_string("/proc/self/limits").unwrap();
    let soft = |name: &str| {
        let line = text.lines().find(|line| line.starts_with(name)).unwrap();
        line[name.len()..].split_whitespace().next().unwrap().parse::<u64>().ok()
    };
    assert_eq!(limit(libc::RLIMIT_RTPRIO), soft("Max realtime priority"));
    assert_eq!(limit(libc::RLIMIT_MEMLOCK), soft("Max locked memory"));
}
