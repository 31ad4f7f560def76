//! The committed models at thousands of random states.

use serde_json::Value;
use std::path::Path;
use std::process::Command;

fn sweep(model: &str) -> Value {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut command = Command::new(env!("CARGO_BIN_EXE_softtwin-studies"));
    command.args(["sweep", "--states", "3000", "--gaps", "50", "--model", model]).current_dir(root);
    let done = command.output().expect("it starts");
    assert!(done.status.success(), "{model}: {}", String::from_utf8_lossy(&done.stderr));
    serde_json::from_slice(&done.stdout).expect("JSON")
}

#[test]
fn force_grows_with_pressure_and_falls_with_the_gap_and_the_regimes_meet() {
    for model in ["models/pneunet/pneunet.twin", "models/gripper/gripper.twin"] {
        let found = sweep(model);
        assert_eq!(found["sweep"]["violation_count"], 0, "{model}: {found}");
        assert_eq!(found["sweep"]["states"], 3000);
    }
}
