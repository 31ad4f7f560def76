//! Runs `softtwin-studies trace`: from a table of cavity volumes to a gauge's readings.

use std::path::Path;
use std::process::{Command, Output};

const VOLUMES: &str = "case,pressure_mpa,gap_mm,cavity_volume_mm3
c0,0,0.5,1400
c1,0.03,0.5,1440.5
c2,0.06,0.5,1490.25
c3,0.06,,1500
";

fn trace(folder: &Path, gap_mm: &str) -> Output {
    let actuator = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/pneunet/actuator.toml");
    let line = format!(
        "trace --actuator {actuator} --volumes volumes.csv --gap-mm {gap_mm} --end-pressure-mpa 0.06 --out t.csv"
    );
    Command::new(env!("CARGO_BIN_EXE_softtwin-studies"))
        .args(line.split(' '))
        .current_dir(folder)
        .env_remove("RUST_LOG")
        .output()
        .unwrap()
}

#[test]
fn trace_is_computed_from_volumes_and_a_missing_gap_is_named() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("volumes.csv"), VOLUMES).unwrap();
    let done = trace(folder.path(), "0.5");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let text = std::fs::read_to_string(folder.path().join("t.csv")).unwrap();
    assert!(text.contains("t_s,pressure_mpa,gap_mm\n") && text.lines().count() > 20, "{text}");
    let refused = trace(folder.path(), "7.5");
    assert_eq!(refused.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("volume table"));
}
