//! The tool in a folder: its exit code and what it says.

use std::path::Path;
use std::process::Command;

/// Exit code, standard output, standard error.
pub fn run(folder: &Path, args: &[&str]) -> (i32, String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_softtwin"));
    let ended = command.args(args).current_dir(folder).env_remove("RUST_LOG").output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (ended.status.code().unwrap(), text(ended.stdout), text(ended.stderr))
}

/// Standard output of a call that must succeed.
pub fn succeeds(folder: &Path, args: &[&str]) -> String {
    let (code, out, err) = run(folder, args);
    assert_eq!(code, 0, "{args:?}: {err}");
    out
}

#[test]
fn error_with_json_option_is_one_object_with_a_code() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("bad.toml"), "name = 3").unwrap();
    for (arguments, exit_code, code) in [
        (&["evaluate", "none.twin", "--database", ".", "--json"][..], 1, "run_time"),
        (&["list", "softtwin//state", "--json"][..], 2, "usage"),
        (&["inspect", "bad.toml", "--json"][..], 78, "configuration"),
    ] {
        let (found, out, err) = run(folder.path(), arguments);
        assert_eq!((found, out.as_str()), (exit_code, ""), "{arguments:?}: {err}");
        let error: serde_json::Value = serde_json::from_str(&err).unwrap();
        assert_eq!((&error["code"], &error["exit_code"]), (&code.into(), &exit_code.into()), "{error}");
    }
}
