use super::*;

/// A tree with these files; each holds its own path.
fn tree(files: &[&str]) -> tempfile::TempDir {
    let tree = tempfile::tempdir().expect("a folder");
    for file in files {
        let path = tree.path().join(file);
        std::fs::create_dir_all(path.parent().expect("a parent")).expect("a folder");
        std::fs::write(path, file).expect("a file");
    }
    tree
}

#[test]
fn an_installed_program_finds_its_share_and_a_checkout_goes_before() {
    let tree = tree(&[
        "usr/bin/softtwin",
        "usr/share/softtwin/a.toml",
        "checkout/a.toml",
        "checkout/crates/x",
        "else/x",
    ]);
    let root = tree.path().canonicalize().expect("a path");
    let own = root.join("usr/bin/softtwin");
    let found = |here: &str| first(&folders(Some(&root.join(here)), Some(&own)), "a.toml");
    assert_eq!(found("else"), Some(root.join("usr/share/softtwin/a.toml")));
    assert_eq!(found("checkout/crates"), Some(root.join("checkout/a.toml")));
}

#[test]
fn a_built_program_finds_the_checkout_above_it_and_nothing_elsewhere() {
    let tree = tree(&["checkout/target/debug/softtwin", "checkout/a.toml", "else/x"]);
    let root = tree.path().canonicalize().expect("a path");
    let folders = folders(Some(&root.join("else")), Some(&root.join("checkout/target/debug/softtwin")));
    assert_eq!(first(&folders, "a.toml"), Some(root.join("checkout/a.toml")));
    assert_eq!(first(&folders, "b.toml"), None);
}
