//! Paths that files have in keys, tables and lines count from the folder of the file, also when that is named without a folder.

use std::collections::BTreeSet;
use std::fs::{create_dir, remove_file, set_permissions, write};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use tests::process::binary;
use tests::skip::{Missing, skipped};
use tests::{Program, Stage};

/// File with paths, and a command line that opens them; `FILE` is the file.
struct Case {
    file: &'static str,
    text: String,
    paths: &'static [&'static str],
    command: &'static str,
}

/// Every file with paths. Keys of scenes one by one: `crates/runtime/tests/unit/config_paths.rs`.
fn cases() -> Vec<Case> {
    let committed = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/pneunet/actuator.toml");
    let actuator: toml::Table = std::fs::read_to_string(committed).unwrap().parse().unwrap();
    let with = |table: &str, file: &str| {
        let mut changed = actuator.clone();
        let mut named = toml::Table::new();
        if table == "mesh" {
            named.clone_from(changed[table].as_table().unwrap());
        }
        named.insert("file".into(), file.into());
        changed.insert(table.into(), named.into());
        changed.to_string()
    };
    let simulate = "softtwin simulate --actuator FILE --pressure 0.01 --gap 30";
    vec![
        Case { file: "a.toml", text: with("mesh", "part.msh"), paths: &["part.msh"], command: simulate },
        Case { file: "b.toml", text: with("elastomer", "gel.toml"), paths: &["gel.toml"], command: simulate },
        Case {
            file: "tests.toml",
            text: "[[test]]\nfile = \"tension.csv\"\n".into(),
            paths: &["tension.csv"],
            command: "softtwin material fit FILE --law gent",
        },
        Case {
            file: "inputs.csv",
            text: "file,load_n\njob.frd,2\n".into(),
            paths: &["job.frd"],
            command: "softtwin import results --inputs FILE --length-unit mm --out imported",
        },
        Case {
            file: "mesh.inp",
            text: "*NODE, INPUT=nodes.inc\n".into(),
            paths: &["nodes.inc"],
            command: "softtwin import FILE --out copy.vtu",
        },
        Case {
            file: "scene.toml",
            text: "name = \"s\"\n[[actuator]]\nname = \"x\"\nmodel = \"m.twin\"\n\
                   source = { kind = \"replay\", trace = \"trace.csv\", log = \"log.toml\" }\n"
                .into(),
            paths: &["m.twin"],
            command: "softtwin inspect FILE",
        },
        Case {
            file: "gateway.toml",
            text: "[security]\ncertificate = \"own.pem\"\nprivate_key = \"own.key\"\nroot_certificate = \"ca.pem\"\n\
                   users_file = \"users\"\nuser = \"a\"\npassword_file = \"password\"\n[ros2]\nmodels = [\"b.twin\"]\n"
                .into(),
            paths: &["own.pem", "own.key", "ca.pem", "users", "password", "b.twin"],
            command: "softtwin doctor --gateway FILE",
        },
    ]
}

/// Paths that a run of the command does not find. Their content is no data, so that no run succeeds.
fn missing(stage: &Stage, folder: &str, case: &Case, file: &str) -> BTreeSet<&'static str> {
    let line = format!("cd {folder} && {}", case.command.replace("FILE", file));
    let (status, said) = Program::shell(stage, &line).ended();
    assert!(!status.success(), "{line}: {said:?}");
    let is_missing =
        |path: &&&str| said.iter().any(|line| line.contains("No such file") && line.contains(**path));
    case.paths.iter().filter(is_missing).copied().collect()
}

#[test]
fn every_path_in_a_file_counts_from_its_folder() {
    let stage = Stage::new("paths");
    create_dir(stage.path("folder")).unwrap();
    for case in cases() {
        if case.command.contains("--gateway")
            && !binary("softtwin").with_file_name("softtwin-gateway").is_file()
        {
            skipped(Missing::Gateway);
            continue;
        }
        let at = |name: &str| stage.path("folder").join(name);
        write(at(case.file), &case.text).unwrap();
        for path in case.paths {
            write(at(path), "no data\n").unwrap();
            set_permissions(at(path), PermissionsExt::from_mode(0o600)).unwrap();
        }
        for (folder, file) in [("folder", case.file.to_owned()), (".", format!("folder/{}", case.file))] {
            assert_eq!(missing(&stage, folder, &case, &file), BTreeSet::new(), "{file} in {folder}");
        }
        case.paths.iter().for_each(|path| remove_file(at(path)).unwrap());
        let all = case.paths.iter().copied().collect();
        assert_eq!(missing(&stage, "folder", &case, case.file), all, "{}: they are opened", case.file);
    }
}
