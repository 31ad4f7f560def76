//! `scripts/setup.sh`: programs that are missing are installed by root, named otherwise.

use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Output};

/// Runs `require NAMES` with only the shell, `basename` and the given scripts in PATH.
fn require(folder: &Path, scripts: &[(&str, &str)], names: &str) -> Output {
    std::os::unix::fs::symlink("/usr/bin/basename", folder.join("basename")).unwrap();
    for (name, text) in scripts {
        let path = folder.join(name);
        std::fs::write(&path, format!("#!/bin/bash\n{text}\n")).unwrap();
        std::fs::set_permissions(&path, PermissionsExt::from_mode(0o755)).unwrap();
    }
    let setup = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scripts/setup.sh");
    let line = format!(". {}; require {names}", setup.display());
    Command::new("/bin/bash").args(["-c", &line]).env("PATH", folder).output().unwrap()
}

#[test]
fn missing_programs_are_named_in_one_line_without_root() {
    let folder = tempfile::tempdir().unwrap();
    let output = require(folder.path(), &[("id", "echo 1000")], "basename cc strace venv");
    assert_eq!(output.status.code(), Some(1));
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(said.lines().count(), 1, "{said}");
    assert!(said.contains("apt-get install -y gcc libc6-dev strace python3-venv"), "{said}");
}

#[test]
fn missing_programs_are_installed_by_root() {
    let folder = tempfile::tempdir().unwrap();
    // As apt-get does, but the program is an empty one.
    let install = format!(
        "echo \"$@\" >> {0}/calls; PATH=/usr/bin:/bin; printf '#!/bin/bash\\n' > {0}/strace; chmod +x {0}/strace",
        folder.path().display()
    );
    let output = require(folder.path(), &[("id", "echo 0"), ("apt-get", &install)], "strace");
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let calls = std::fs::read_to_string(folder.path().join("calls")).unwrap();
    assert_eq!(calls, "update -qq\ninstall -y -qq strace\n");
}
