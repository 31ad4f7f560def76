//! A few of the random actuators: each is solved or refused with a reason.

use std::path::Path;
use std::process::Command;

#[test]
fn random_actuators_of_boxes_and_mesh_files_end_with_a_state_or_a_reason() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut command = Command::new(env!("CARGO_BIN_EXE_softtwin-studies"));
    let done = command.args(["random-shapes", "--count", "5"]).current_dir(root).output().expect("it starts");
    let said = String::from_utf8_lossy(&done.stdout);
    assert!(done.status.success(), "{said}{}", String::from_utf8_lossy(&done.stderr));
    println!("{said}");
    let ends =
        said.lines().filter(|line| ["solved", "refused", "no state"].iter().any(|end| line.contains(end)));
    assert_eq!(ends.count(), 6, "five actuators and the counts: {said}");
}
