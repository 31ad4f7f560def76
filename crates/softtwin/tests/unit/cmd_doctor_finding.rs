//! Tests of `src/cmd/doctor/finding.rs`.

use super::*;

#[test]
fn bad_finding_shows_its_remedy() {
    assert_eq!(Finding::good("model", "read").to_string(), "ok    model: read");
    let bad = Finding::bad("/dev/shm", "1 MB free", "free space").to_string();
    assert_eq!(bad, "BAD   /dev/shm: 1 MB free\n      -> free space");
}
