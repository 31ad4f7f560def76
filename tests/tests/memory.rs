//! A full /dev/shm is an error text at start, not a SIGBUS in the middle of the night.

use std::process::Command;
use tests::skip::{Missing, skipped};
use tests::{Program, Stage};

/// A private /dev/shm needs a mount namespace, which needs rights.
fn may_mount() -> bool {
    let line = "mount -t tmpfs -o size=1m tmpfs /dev/shm";
    Command::new("unshare")
        .args(["-m", "sh", "-c", line])
        .output()
        .is_ok_and(|output| output.status.success())
}

#[test]
fn full_shared_memory_is_refused_with_bytes_and_remedy() {
    if !may_mount() {
        return skipped(Missing::SmallSharedMemory);
    }
    let stage = Stage::new("full");
    stage.finger("kind = \"simulate\"");
    // Too little for anything, too little for the fields, enough.
    for (size, code) in [("512k", 1), ("1400k", 1), ("64m", 0)] {
        let line = format!(
            "mount -t tmpfs -o size={size} tmpfs /dev/shm && timeout -s TERM 5 softtwind twin --scene finger.toml"
        );
        let mut twin = Program::shell(&stage, &format!("unshare -m sh -c '{line}'; echo code $?"));
        let (_, said) = twin.end();
        let text = said.join("\n");
        if code == 0 {
            assert!(text.contains("ready:"), "{text}");
        } else {
            assert!(text.contains("code 1") && !text.contains("ready:"), "{text}");
            assert!(text.contains("/dev/shm"), "{text}");
        }
    }
}
