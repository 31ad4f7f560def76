//! The C and C++ examples, compiled as their headers say, against a running twin.

use std::path::{Path, PathBuf};
use std::process::Command;
use tests::skip::{Missing, skipped};
use tests::{Program, Stage};

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap()
}

/// A folder with the library under its installed names, as `scripts/install_c.sh` makes it.
fn libraries(stage: &Stage) -> PathBuf {
    // `target/<profile>/deps` is where cargo puts the library of the test that runs.
    let library = std::env::current_exe().unwrap().with_file_name("libcapi.so");
    let folder = stage.path("lib");
    std::fs::create_dir_all(&folder).unwrap();
    for name in ["libsofttwin.so", "libsofttwin.so.0"] {
        let link = folder.join(name);
        if !link.exists() {
            std::os::unix::fs::symlink(&library, link).unwrap();
        }
    }
    folder
}

/// Compiles an example; `None` without a C++ compiler.
fn compile(stage: &Stage, compiler: &str, standard: &str, example: &str) -> Option<String> {
    if compiler == "c++" && Command::new(compiler).arg("--version").output().is_err() {
        skipped(Missing::CppCompiler);
        return None;
    }
    let out = stage.path(&example.replace('.', "_"));
    let libraries = libraries(stage);
    let done = Command::new(compiler)
        .args([standard, "-Wall", "-Wextra", "-Werror", "-pedantic", "-O1"])
        .arg(repository().join("clients/c/examples").join(example))
        .arg("-I")
        .arg(repository().join("crates/capi/include"))
        .arg("-L")
        .arg(&libraries)
        .arg(format!("-Wl,-rpath,{}", libraries.display()))
        .args(["-lsofttwin", "-lm", "-o"])
        .arg(&out)
        .output()
        .unwrap();
    assert!(done.status.success(), "{example}:\n{}", String::from_utf8_lossy(&done.stderr));
    Some(out.display().to_string())
}

fn scene(stage: &Stage) -> PathBuf {
    stage.write(
        "finger.toml",
        "name = \"s\"\n[[actuator]]\nname = \"finger\"\nmodel = \"beam.twin\"\n[actuator.source]\nkind = \"simulate\"\n\
         rate_hz = 500.0\ngap_mm = 25.0\n[[actuator.output]]\nnodes = \"all\"",
    )
}

#[test]
fn the_examples_run_in_c_and_in_cpp() {
    // The rlib of this test and the shared library are of the same build.
    assert_eq!(capi::softtwin_layout_version(), 3);
    let stage = Stage::new("capi");
    let scene = scene(&stage);
    let programs: Vec<String> = [("cc", "-std=c11", "twin.c"), ("c++", "-std=c++17", "twin.cpp")]
        .into_iter()
        .filter_map(|(compiler, standard, example)| compile(&stage, compiler, standard, example))
        .collect();
    assert!(!programs.is_empty(), "not even a C compiler is here");
    for program in &programs {
        let (status, said) = Program::shell(&stage, program).end();
        assert_eq!(status.code(), Some(1), "without a twin: {said:?}");
        assert!(said.join("\n").contains("nothing is there"), "{said:?}");
    }
    let twin = Program::twin(&stage, &scene);
    let bridge = Program::bridge(&stage, &scene);
    for program in &programs {
        let (status, said) = Program::shell(&stage, program).end();
        assert!(status.success(), "{program}: {said:?}");
        let all = said.join("\n");
        for expected in ["120 nodes", "what if: 0.", "refused: more force than the sampled states give here"]
        {
            assert!(all.contains(expected), "{program}: `{expected}` is missing in {all}");
        }
    }
    if let Some(latency) = compile(&stage, "cc", "-std=c11", "latency.c") {
        for what in ["state", "field"] {
            let (status, said) = Program::shell(&stage, &format!("{latency} 1 {what}")).end();
            assert!(status.success(), "{said:?}");
            assert!(said[0].contains(&format!("\"what\":\"{what}\"")), "{said:?}");
        }
    }
    drop((bridge, twin));
}
