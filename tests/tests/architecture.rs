//! Rules that the compiler does not check: which crate may use which, no circles of files, reasons to skip.

use rom::memory::{InputMemory, Slopes};
use rom::observable::ObservableKind;
use rom::radial::{KernelKind, Tail};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;
use tests::modules::Modules;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").canonicalize().expect("the repository")
}

/// The table of ARCHITECTURE.md: crate -> crates it may use.
fn allowed() -> BTreeMap<String, BTreeSet<String>> {
    let text = std::fs::read_to_string(root().join("ARCHITECTURE.md")).expect("ARCHITECTURE.md");
    let mut table: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    let mut crates = BTreeSet::new();
    for line in text.lines().filter(|line| line.starts_with("| `")) {
        let cells: Vec<&str> = line.trim_matches('|').split(" | ").map(str::trim).collect();
        let [user, _, may_use] = cells.as_slice() else { continue };
        let user = user.trim_matches('`').trim_start_matches("crates/").to_owned();
        let used: BTreeSet<String> = match *may_use {
            "nothing of ours" => BTreeSet::new(),
            "all of the above" => crates.clone(),
            names => names.split(',').map(|name| name.trim().trim_matches('`').to_owned()).collect(),
        };
        crates.insert(user.clone());
        table.insert(user, used);
    }
    table
}

fn metadata() -> Value {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--no-deps", "--offline"])
        .current_dir(root())
        .output()
        .expect("cargo metadata");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("JSON")
}

#[test]
fn crates_use_only_allowed_crates() {
    let allowed = allowed();
    assert!(allowed.len() >= 8, "the table of ARCHITECTURE.md was not understood: {allowed:?}");
    let names: BTreeMap<String, &String> = allowed.keys().map(|name| (name.clone(), name)).collect();
    let metadata = metadata();
    let packages = metadata["packages"].as_array().expect("packages");
    let mut checked = 0;
    for found in packages {
        let name = found["name"].as_str().expect("name");
        let user =
            names.get(name).unwrap_or_else(|| panic!("`{name}` is in no row of ARCHITECTURE.md's table"));
        for dependency in found["dependencies"].as_array().expect("dependencies") {
            // What only tests use does not make a dependency.
            let is_test_only = dependency["kind"] == "dev";
            let Some(used) = dependency["name"].as_str().and_then(|name| names.get(name)) else { continue };
            assert!(
                is_test_only || allowed[*user].contains(*used),
                "`{user}` uses `{used}`, which ARCHITECTURE.md does not allow"
            );
            checked += 1;
        }
    }
    assert!(checked >= 10, "only {checked} dependencies between crates were seen");
}

/// The crates that a build of these packages takes, each with its version and its features, one a line.
fn features(selection: &[&str]) -> BTreeSet<String> {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--locked", "--offline", "--prefix", "none", "--no-dedupe", "--format", "{p} {f}"])
        .args(selection)
        .current_dir(root())
        .output()
        .expect("cargo tree");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("UTF-8").lines().map(str::to_owned).collect()
}

#[test]
fn demonstration_and_tests_share_one_build() {
    let demo = features(&["-p", "softtwind", "--edges", "normal,build"]);
    let tests = features(&["--workspace", "--edges", "normal,build,dev"]);
    assert!(demo.len() > 100, "only {} crates were seen", demo.len());
    let twice: Vec<&String> = demo.difference(&tests).collect();
    assert!(twice.is_empty(), "compiled again for the tests; name their features in Cargo.toml: {twice:#?}");
}

fn read(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// Tests are modules of few programs: a file that none of them names would never run.
#[test]
fn every_test_file_is_in_a_test_program() {
    let metadata = metadata();
    let mut checked = 0;
    for package in metadata["packages"].as_array().expect("packages") {
        let folder = Path::new(package["manifest_path"].as_str().expect("a path")).with_file_name("tests");
        let programs: Vec<&str> = package["targets"]
            .as_array()
            .expect("targets")
            .iter()
            .filter(|target| target["kind"][0] == "test")
            .map(|target| target["src_path"].as_str().expect("a path"))
            .collect();
        let roots: String =
            programs.iter().map(|path| std::fs::read_to_string(path).expect("UTF-8")).collect();
        for entry in std::fs::read_dir(&folder).into_iter().flatten() {
            let path = entry.expect("an entry").path();
            let name = path.file_stem().and_then(|name| name.to_str()).expect("a name").to_owned();
            if path.extension().is_some_and(|end| end == "rs") {
                let is_program = programs.iter().any(|program| Path::new(program) == path);
                assert!(
                    is_program || roots.contains(&format!("mod {name};")),
                    "{}: in no test program",
                    path.display()
                );
                checked += 1;
            }
        }
    }
    assert!(checked >= 60, "only {checked} files were seen");
}

/// A source file that no `mod` names is not compiled.
#[test]
fn every_source_file_is_a_module() {
    let metadata = metadata();
    let mut checked = 0;
    for package in metadata["packages"].as_array().expect("packages") {
        let targets = package["targets"].as_array().expect("targets");
        let roots: Vec<&str> = targets.iter().filter_map(|target| target["src_path"].as_str()).collect();
        let folder = Path::new(package["manifest_path"].as_str().expect("a path")).with_file_name("src");
        let mut files = Vec::new();
        if folder.is_dir() {
            sources(&folder, &mut files);
        }
        let is_module = |path: &PathBuf| {
            path.extension().is_some_and(|end| end == "rs")
                && !roots.iter().any(|root| Path::new(root) == path)
        };
        for (path, _) in files.iter().filter(|(path, _)| is_module(path)) {
            let is_folder = path.ends_with("mod.rs");
            let module = if is_folder { path.parent().expect("a folder") } else { path };
            let (name, folder) = (module.file_stem().expect("a name"), module.parent().expect("a folder"));
            let declaration = format!("mod {};", name.to_string_lossy());
            let parents = [folder.with_extension("rs"), folder.join("mod.rs")];
            let mut parents = parents.iter().map(PathBuf::as_path).chain(roots.iter().map(Path::new));
            assert!(
                parents
                    .any(|parent| files.iter().any(|(at, text)| at == parent && text.contains(&declaration))),
                "{}: no `{declaration}`",
                path.display()
            );
            checked += 1;
        }
    }
    assert!(checked > 300, "only {checked} files were seen");
}

/// `test = false` saves the building of a test program; it must not hide a test.
#[test]
fn untested_targets_have_no_tests() {
    let metadata = metadata();
    let packages = metadata["packages"].as_array().expect("packages");
    let mut checked = 0;
    for target in packages.iter().flat_map(|package| package["targets"].as_array().expect("targets")) {
        let kind = target["kind"][0].as_str().expect("a kind");
        if target["test"] == true || ["example", "custom-build"].contains(&kind) {
            continue;
        }
        if kind == "test" {
            // Too long for every run: CI has a separate command.
            let command = format!("--test {}", target["name"].as_str().expect("a name"));
            assert!(read("scripts/check.sh").contains(&command), "test = false, and no check runs {command}");
            continue;
        }
        let path = Path::new(target["src_path"].as_str().expect("a path"));
        let mut files = vec![(path.to_owned(), std::fs::read_to_string(path).expect("UTF-8"))];
        if kind != "bin" {
            sources(path.parent().expect("a folder"), &mut files);
        }
        let word = ["#[te", "st]"].concat();
        let hidden: Vec<&PathBuf> =
            files.iter().filter(|(_, text)| text.contains(&word)).map(|(path, _)| path).collect();
        assert!(hidden.is_empty(), "test = false, but there are tests: {hidden:#?}");
        checked += 1;
    }
    assert!(checked >= 5, "only {checked} such targets were seen");
}

#[test]
fn files_of_a_crate_form_no_circle() {
    let mut circles = Vec::new();
    let crates = std::fs::read_dir(root().join("crates")).expect("crates");
    let folders = crates.map(|entry| entry.expect("an entry").path());
    for folder in folders.chain([root().join("studies")]) {
        let name = folder.file_name().expect("a name").to_string_lossy().into_owned();
        let found = Modules::read(&folder.join("src")).circles();
        circles.extend(found.into_iter().map(|circle| format!("{name}: {}", circle.join(", "))));
    }
    assert!(circles.is_empty(), "{} circles of files:\n{}", circles.len(), circles.join("\n"));
}

/// Files of these kinds are read by people.
const SOURCES: [&str; 4] = ["rs", "sh", "py", "toml"];
/// Folders of results.
const RESULTS: [&str; 3] = ["target", "build", ".git"];

/// Text of every source file, by its path.
fn sources(folder: &Path, found: &mut Vec<(PathBuf, String)>) {
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        let ending = path.extension().map(|ending| ending.to_string_lossy().into_owned());
        if path.is_dir() && !RESULTS.iter().any(|name| path.ends_with(name)) {
            sources(&path, found);
        } else if ending.is_some_and(|ending| SOURCES.contains(&ending.as_str())) {
            let text = std::fs::read_to_string(&path).expect("UTF-8");
            found.push((path, text));
        }
    }
}

fn all_sources() -> Vec<(PathBuf, String)> {
    let mut found = Vec::new();
    sources(&root(), &mut found);
    assert!(found.len() > 100, "only {} source files were found", found.len());
    found
}

#[test]
fn tests_are_skipped_only_for_listed_reasons() {
    let word = ["SKIP", "PED"].concat();
    let elsewhere: Vec<PathBuf> = all_sources()
        .into_iter()
        .filter(|(path, text)| text.contains(&word) && !path.ends_with("tests/src/skip.rs"))
        .map(|(path, _)| path)
        .collect();
    assert!(elsewhere.is_empty(), "use tests::skip::skipped: {elsewhere:#?}");
}

/// A value of each variant of an enum; does not compile if one is left out.
macro_rules! every {
    [$($type:ident::$kind:ident $({ $field:ident: $value:expr })?),+ $(,)?] => {{
        let _ = |kind| match kind { $($type::$kind { .. } => ()),+ };
        [$($type::$kind { $($field: $value)? }),+]
    }};
}

/// The equations in Python refuse a kind that they do not know. One that is added to the model has to be added there too: here it does not
/// compile, or is not found, until it is.
#[test]
fn equations_in_python_know_every_kind() {
    let equations = read("clients/python/src/softtwin/equations.py");
    let motion = read("clients/python/src/softtwin/differentiable.py");
    let name = |kind: Value| match kind {
        Value::String(name) => name,
        Value::Object(named) => named.keys().next().expect("a name").clone(),
        other => panic!("{other} has no name"),
    };
    let json = |kind: Result<Value, serde_json::Error>| kind.expect("JSON");

    let kernels = every![
        KernelKind::Linear,
        KernelKind::ThinPlate,
        KernelKind::Cubic,
        KernelKind::Quintic,
        KernelKind::Gaussian { shape: 1.0 },
        KernelKind::Matern72 { length: 1.0 },
        KernelKind::CubicQuintic { crossover: 1.0 },
    ];
    for kind in kernels {
        let name = name(json(serde_json::to_value(kind)));
        assert!(equations.contains(&format!("\n    \"{name}\": ")), "kernel {name}");
    }

    let tails = every![Tail::None, Tail::Constant, Tail::Linear, Tail::Quadratic];
    let orders = equations.lines().find(|line| line.starts_with("TAIL_ORDERS")).expect("orders of tails");
    for tail in tails {
        let name = name(json(serde_json::to_value(tail)));
        assert!(orders.contains(&format!("\"{name}\": ")), "tail {name}");
    }

    let observables = every![
        ObservableKind::SectionAngle,
        ObservableKind::ChordAngle,
        ObservableKind::Curvature,
        ObservableKind::Length,
        ObservableKind::Position,
        ObservableKind::Volume,
    ];
    for kind in observables {
        let name = name(json(serde_json::to_value(kind)));
        assert!(equations.contains(&format!("item[\"kind\"] == \"{name}\"")), "observable {name}");
    }

    let memory = InputMemory {
        input: 0,
        range: [0.0, 1.0],
        line: None,
        orifice: None,
        play: Vec::new(),
        creep: Vec::new(),
        slopes: Slopes::default(),
    };
    let memory = json(serde_json::to_value(memory));
    let mut blocks = 0;
    // The range and the slopes are those of an unknown past, which the functions in Python do not have.
    for name in memory.as_object().expect("keys").keys() {
        if !["input", "range", "slopes"].contains(&name.as_str()) {
            assert!(motion.contains(&format!("of[\"{name}\"]")), "memory {name}");
            blocks += 1;
        }
    }
    assert_eq!(blocks, 4, "blocks of a memory");
}
