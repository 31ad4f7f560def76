//! Cards of models: those beside the shipped models are current.

use std::path::{Path, PathBuf};
use std::process::Command;

/// Output of `softtwin inspect` for a model.
fn inspected(model: &Path, arguments: &[&str]) -> String {
    let program = env!("CARGO_BIN_EXE_softtwin");
    let output = Command::new(program).arg("inspect").arg(model).args(arguments).output().expect("it starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("UTF-8")
}

fn shipped_models() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
    let files = std::fs::read_dir(folder).expect("models").flat_map(|entry| {
        let inside = std::fs::read_dir(entry.expect("an entry").path()).expect("a folder");
        inside.map(|file| file.expect("an entry").path())
    });
    let mut models: Vec<PathBuf> =
        files.filter(|file| file.extension().is_some_and(|e| e == "twin")).collect();
    models.sort();
    models
}

#[test]
fn cards_of_shipped_models_are_current() {
    let models = shipped_models();
    assert!(models.len() >= 2, "{models:?}");
    for model in models {
        let place = model.with_extension("card.json");
        let licence = ["--card", "json", "--licence", "MIT OR Apache-2.0"];
        let expected = inspected(&model, &licence);
        if std::env::var_os("BLESS").is_some() {
            std::fs::write(&place, &expected).expect("writable");
        }
        let found = std::fs::read_to_string(&place).unwrap_or_default();
        assert!(
            found == expected,
            "{} is not the card of the model beside it; BLESS=1 cargo test --workspace --test all -- card::",
            place.display()
        );
        assert_eq!(
            inspected(&model, &["--card", "json"]),
            expected,
            "the licence of the card beside it is kept"
        );
        let page = inspected(&model, &["--card", "markdown"]);
        assert!(page.contains("| pressure_mpa | MPa | 0") && page.contains("MIT OR Apache-2.0"), "{page}");
        let aas: serde_json::Value =
            serde_json::from_str(&inspected(&model, &["--card", "aas"])).expect("JSON");
        assert_eq!(aas["submodelElements"][0]["idShort"], "SimulationModel00");
    }
}
