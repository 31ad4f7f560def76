//! Packages of others, checked without a network: `deny.toml` against the lock file and the packages' own descriptions, and the table of
//! dependencies in ARCHITECTURE.md.

use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

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

/// Packages of this platform with their dependencies, as Cargo knows them.
fn metadata() -> Value {
    let platform = format!("{}-unknown-linux-gnu", std::env::consts::ARCH);
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--locked", "--offline", "--filter-platform", &platform])
        .args(["--features", "gateway/network"])
        .current_dir(root())
        .output()
        .expect("cargo metadata");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("JSON")
}

/// Whether a licence expression is satisfied by the allowed licences: `AND` binds closer than `OR`, `/` is an old `OR`.
fn is_allowed(expression: &str, allowed: &BTreeSet<String>) -> bool {
    if let Some((before, rest)) = expression.split_once('(') {
        let (inner, after) = rest.split_once(')').expect("a closing bracket");
        let inner = if is_allowed(inner, allowed) { allowed.first().expect("a licence") } else { "none" };
        return is_allowed(&format!("{before}{inner}{after}"), allowed);
    }
    let any = expression.replace('/', " OR ");
    any.split(" OR ").any(|all| all.split(" AND ").all(|one| allowed.contains(one.trim())))
}

#[test]
fn licences_are_allowed_and_each_allowed_one_is_needed() {
    let allowed = strings(&toml_of("deny.toml")["licenses"]["allow"]);
    let metadata = metadata();
    let packages = metadata["packages"].as_array().expect("packages").iter();
    let foreign: Vec<&Value> = packages.filter(|package| !package["source"].is_null()).collect();
    assert!(foreign.len() > 300, "only {} packages were seen", foreign.len());
    let refused = |allowed: &BTreeSet<String>| {
        let is_refused =
            |package: &&&Value| !is_allowed(package["license"].as_str().unwrap_or("none"), allowed);
        foreign
            .iter()
            .filter(is_refused)
            .map(|package| format!("{}: {}", package["name"], package["license"]))
            .collect::<Vec<_>>()
    };
    assert_eq!(refused(&allowed), [] as [String; 0]);
    for licence in &allowed {
        let others = allowed.iter().filter(|other| *other != licence).cloned().collect();
        assert!(!refused(&others).is_empty(), "no package needs {licence}: remove it from deny.toml");
    }
}

#[test]
fn packages_come_from_the_registry_or_this_repository() {
    let allowed = strings(&toml_of("deny.toml")["sources"]["allow-registry"]);
    for package in locked() {
        let source = text(&package, "source");
        let known = source
            .is_none_or(|source| source.strip_prefix("registry+").is_some_and(|at| allowed.contains(at)));
        assert!(known, "{package}");
        assert_eq!(source.is_some(), text(&package, "checksum").is_some(), "{package}");
    }
}

#[test]
fn second_versions_of_a_package_are_listed() {
    let skipped = strings(&toml_of("deny.toml")["bans"]["skip"]);
    let mut versions: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for package in locked() {
        let part = |key| text(&package, key).expect(key).to_owned();
        versions.entry(part("name")).or_default().push(part("version"));
    }
    let twice: Vec<(String, Vec<String>)> =
        versions.into_iter().filter(|(_, versions)| versions.len() > 1).collect();
    let mut found = BTreeSet::new();
    for (name, versions) in &twice {
        let listed: Vec<String> = versions
            .iter()
            .map(|version| format!("{name}@{version}"))
            .filter(|name| skipped.contains(name))
            .collect();
        assert_eq!(
            listed.len() + 1,
            versions.len(),
            "{name} {versions:?}: list all but the newest in deny.toml"
        );
        found.extend(listed);
    }
    let gone: Vec<&String> = skipped.difference(&found).collect();
    assert!(gone.is_empty(), "in deny.toml, and not in the lock file: {gone:?}");
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

#[test]
fn every_locked_package_is_reached_from_a_justified_dependency() {
    let metadata = metadata();
    let members = metadata["workspace_members"].as_array().expect("members");
    let own = metadata["packages"]
        .as_array()
        .expect("packages")
        .iter()
        .filter(|package| members.contains(&package["id"]));
    let justified = justified();
    let mut direct = BTreeSet::new();
    for dependency in own.flat_map(|package| package["dependencies"].as_array().expect("dependencies")) {
        let name = dependency["name"].as_str().expect("a name");
        if dependency["path"].is_null() {
            assert!(justified.contains(name), "{name}: no line in ARCHITECTURE.md's table of dependencies");
            assert_ne!(dependency["req"], "*", "{name}: any version");
            direct.insert(name.to_owned());
        }
    }
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
