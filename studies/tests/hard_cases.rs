//! Every hard case ends as it must: correct, refused with a reason, or flagged.

use serde_json::Value;
use std::process::Command;

#[test]
fn every_hard_case_has_its_expected_ending() {
    let program = env!("CARGO_BIN_EXE_softtwin-studies");
    let done = Command::new(program).args(["hard-cases", "--json"]).output().expect("it starts");
    let out = String::from_utf8(done.stdout).expect("text");
    assert!(done.status.success(), "{out}{}", String::from_utf8_lossy(&done.stderr));
    let rows: Vec<Value> = out.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    assert!(rows.len() >= 29, "only {} cases", rows.len());
    for row in &rows {
        assert_eq!(row["ours"]["ending"], row["expected"], "{row}");
        assert_ne!(row["ours"]["ending"], "silently_wrong", "{row}");
    }
}
