//! `softtwin-studies report --check` passes if the acceptance limits hold, and names those that are exceeded.

use formats::vtu::Cells;
use rom::snapshots::{Database, RegimeKind, Split};
use std::path::Path;
use std::process::{Command, Output};
use studies::synthetic::{database, training_states};

/// An actuator of formulas with test cases and states that no training sees.
fn plate() -> Database {
    let mut states = training_states(24, 12, 11);
    states.extend([(Split::Test, 0.033, None), (Split::Test, 0.061, None)]);
    states.extend([(Split::Test, 0.061, Some(17.3)), (Split::Test, 0.047, Some(29.0))]);
    states.extend((0..6).map(|i| {
        let along = f64::from(i) / 6.0;
        (Split::Check, 0.03 + 0.05 * along, Some(12.0 + 20.0 * along))
    }));
    let mut plate = database(&states);
    plate
        .cases
        .iter_mut()
        .filter(|c| c.split == Split::Check)
        .for_each(|c| c.name = format!("random{}", c.name));
    plate
}

fn check(folder: &Path, database: &Database) -> Output {
    formats::database::write(&folder.join("db"), database, Cells::QuadraticTets(&[])).expect("writable");
    let mut command = Command::new(env!("CARGO_BIN_EXE_softtwin-studies"));
    command.args(["report", "--database", "db", "--check"]).current_dir(folder).env_remove("RUST_LOG");
    let done = command.output().expect("it starts");
    assert!(!folder.join("docs").exists(), "--check writes nothing");
    done
}

#[test]
fn report_passes_on_a_good_database_and_names_the_exceeded_limit() {
    let (folder, mut database) = (tempfile::tempdir().expect("a folder"), plate());
    let honest = check(folder.path(), &database);
    let out = String::from_utf8_lossy(&honest.stdout);
    assert!(honest.status.success(), "{out}{}", String::from_utf8_lossy(&honest.stderr));
    assert!(out.matches("| yes |").count() > 15 && !out.contains("**no**"), "{out}");
    // The truth of the contact test cases is now 5 % larger in stress: the model is off by as much.
    let (entries, fields) = (database.entries(), database.fields.len());
    let spoiled = |c: &rom::snapshots::Case| c.split == Split::Test && c.regime == RegimeKind::Contact;
    for case in (0..database.cases.len()).filter(|i| spoiled(&database.cases[*i])) {
        let row = &mut database.snapshots[case * entries..(case + 1) * entries];
        row.iter_mut().skip(fields - 1).step_by(fields).for_each(|stress| *stress *= 1.05);
    }
    let broken = check(folder.path(), &database);
    let err = String::from_utf8_lossy(&broken.stderr);
    assert_eq!(broken.status.code(), Some(1), "{err}");
    assert!(err.contains("contact test cases: normalised stress"), "{err}");
    assert_eq!(String::from_utf8_lossy(&broken.stdout).matches("**no**").count(), 1);
}

/// Acceptance limits of the repository's report, also on test states, with its command and its database.
#[test]
fn committed_database_is_within_every_limit() {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut command = Command::new(env!("CARGO_BIN_EXE_softtwin-studies"));
    command.args(["report", "--database", "models/pneunet/database", "--check"]).current_dir(repository);
    let done = command.env_remove("RUST_LOG").output().expect("it starts");
    let out = String::from_utf8_lossy(&done.stdout);
    assert!(done.status.success(), "{out}{}", String::from_utf8_lossy(&done.stderr));
    assert!(out.matches("| yes |").count() > 27 && !out.contains("**no**"), "{out}");
    assert!(out.contains("test states in contact: normalised stress, worst"), "{out}");
}
