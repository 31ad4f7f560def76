//! What the lock file and the manifests tell about packages of others, without a network and without the packages: each direct dependency
//! has a line in ARCHITECTURE.md, each line a dependency, and each locked package is needed. Licences, sources and second versions are
//! rules of `deny.toml`, which `scripts/check.sh dependencies` applies.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn toml_of(path: &str) -> toml::Table {
    let text = std::fs::read_to_string(root().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"));
    text.parse().unwrap_or_else(|error| panic!("{path}: {error}"))
}

fn strings(list: &toml::Value) -> BTreeSet<String> {
    let list = list.as_array().expect("a list").iter();
    list.map(|text| text.as_str().expect("a string").to_owned()).collect()
}

/// Packages of the lock file.
fn locked() -> Vec<toml::Value> {
    toml_of("Cargo.lock")["package"].as_array().expect("packages").clone()
}

fn text<'a>(package: &'a toml::Value, key: &str) -> Option<&'a str> {
    package.get(key).and_then(toml::Value::as_str)
}

/// Names in the first cells of the table in ARCHITECTURE.md; `-c64` behind `nano-gemm-c32` is `nano-gemm-c64`.
fn justified() -> BTreeSet<String> {
    let document = std::fs::read_to_string(root().join("ARCHITECTURE.md")).expect("ARCHITECTURE.md");
    let section =
        document.split("\n## ").find(|section| section.starts_with("Dependencies")).expect("a section");
    let cells = section.lines().filter(|line| line.starts_with("| ")).skip(2);
    let mut names = BTreeSet::new();
    for cell in cells.filter_map(|line| line.trim_matches('|').split('|').next()) {
        let mut stem = "";
        for name in cell.split(',').map(str::trim) {
            let whole = if name.starts_with('-') { format!("{stem}{name}") } else { name.to_owned() };
            stem = if name.starts_with('-') {
                stem
            } else {
                name.rsplit_once('-').map_or(name, |(stem, _)| stem)
            };
            names.insert(whole);
        }
    }
    names
}

/// Tables of dependencies of a manifest, those for one platform too.
fn dependencies_of(manifest: &toml::Table) -> Vec<(String, toml::Value)> {
    let platforms = manifest.get("target").and_then(toml::Value::as_table);
    let platforms = platforms.into_iter().flat_map(toml::Table::values).filter_map(toml::Value::as_table);
    let tables = std::iter::once(manifest).chain(platforms);
    let kinds = ["dependencies", "dev-dependencies", "build-dependencies"];
    tables
        .flat_map(|table| kinds.iter().filter_map(|kind| table.get(*kind)?.as_table()))
        .flatten()
        .map(|(name, dependency)| (name.clone(), dependency.clone()))
        .collect()
}

#[test]
fn every_locked_package_is_reached_from_a_justified_dependency() {
    let justified = justified();
    let workspace = toml_of("Cargo.toml");
    let versions = workspace["workspace"]["dependencies"].as_table().expect("versions");
    let mut direct = BTreeSet::new();
    for member in strings(&workspace["workspace"]["members"]) {
        for (name, dependency) in dependencies_of(&toml_of(&format!("{member}/Cargo.toml"))) {
            let is_shared = dependency.get("workspace").is_some();
            let dependency = if is_shared { &versions[&name] } else { &dependency };
            if dependency.get("path").is_some() {
                continue;
            }
            assert!(
                justified.contains(&name),
                "{member}: {name}: no line in ARCHITECTURE.md's table of dependencies"
            );
            let version = dependency.as_str().or_else(|| dependency.get("version")?.as_str());
            assert!(version.is_some_and(|version| version != "*"), "{member}: {name}: any version");
            direct.insert(name);
        }
    }
    assert!(direct.len() > 40, "only {} direct dependencies were seen", direct.len());
    // The ROS 2 peer is a separate package.
    let keys = |table: &toml::Value| table.as_table().expect("a table").keys().cloned().collect::<Vec<_>>();
    let peer = toml_of("scripts/checks/ros2_peer/Cargo.toml");
    let elsewhere: BTreeSet<String> =
        [&peer["dependencies"], &peer["build-dependencies"]].into_iter().flat_map(keys).collect();
    for name in &justified {
        assert!(
            direct.contains(name) || elsewhere.contains(name),
            "{name}: in ARCHITECTURE.md, and nothing needs it"
        );
    }
    let packages = locked();
    let mut waiting: Vec<String> = packages
        .iter()
        .filter(|package| text(package, "source").is_none())
        .filter_map(|package| text(package, "name"))
        .map(str::to_owned)
        .collect();
    let mut reached: BTreeSet<String> = BTreeSet::new();
    while let Some(next) = waiting.pop() {
        // A dependency is `name`, or `name version` where several are locked.
        let (name, version) =
            next.split_once(' ').map_or((next.as_str(), None), |(name, version)| (name, Some(version)));
        let found = packages.iter().filter(|package| {
            text(package, "name") == Some(name)
                && version.is_none_or(|version| text(package, "version") == Some(version))
        });
        for package in found {
            let id = format!("{name} {}", text(package, "version").expect("a version"));
            if reached.insert(id) {
                waiting.extend(package.get("dependencies").map(strings).unwrap_or_default());
            }
        }
    }
    let lost: Vec<String> = packages
        .iter()
        .map(|package| {
            format!(
                "{} {}",
                text(package, "name").expect("a name"),
                text(package, "version").expect("a version")
            )
        })
        .filter(|id| !reached.contains(id))
        .collect();
    assert!(lost.is_empty(), "no package of ours needs {lost:?}");
    println!("{} packages are locked", packages.len());
}
