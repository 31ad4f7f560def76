//! Tests of `src/saved.rs`.

use super::*;

#[test]
fn every_part_is_in_the_bundle_once_and_before_it_is_used() {
    let script = bundle().expect("parts of ours");
    for (path, kind, _) in PARTS.iter().filter(|(path, kind, _)| *kind == SCRIPT && *path != "/main.js") {
        let declaration = format!("const {} = (() => {{", variable(path.trim_start_matches('/')));
        assert_eq!(script.matches(&declaration).count(), 1, "{path} {kind}");
        let at = script.find(&declaration).expect("counted");
        let used = script.find(&format!("}} = {};", variable(path.trim_start_matches('/'))));
        assert!(used.is_some_and(|used| at < used), "{path}");
    }
    assert!(!script.lines().any(|line| line.starts_with("import ") || line.starts_with("export ")));
}

#[test]
fn names_of_declarations() {
    let lines = [
        "class Link {",
        "function unpack(buffer) {",
        "const css = (name) => 1;",
        "async function embedded() {",
    ];
    assert_eq!(lines.map(declared), ["Link", "unpack", "css", "embedded"].map(Some));
}
