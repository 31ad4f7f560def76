//! `softtwin.h` declares the functions of the code: the same names, parameters and types.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

fn here() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// A type of the code as C writes it.
fn c_type(rust: &str) -> String {
    if let Some(target) = rust.strip_prefix("*mut ") {
        return format!("{}*", c_type(target));
    }
    if let Some(target) = rust.strip_prefix("*const ") {
        return format!("const {}*", c_type(target)).replace("const const", "const");
    }
    let known = [
        ("c_char", "char"),
        ("c_int", "int"),
        ("c_void", "void"),
        ("f32", "float"),
        ("f64", "double"),
        ("i64", "int64_t"),
        ("u8", "uint8_t"),
        ("u32", "uint32_t"),
        ("u64", "uint64_t"),
        ("usize", "size_t"),
        ("Answer", "softtwin_answer"),
        ("FieldHeader", "softtwin_field_header"),
        ("Query", "softtwin_query"),
    ];
    known.iter().find(|(name, _)| *name == rust).map_or(rust, |(_, c)| c).to_owned()
}

/// Functions by name: parameter types and the type of the result.
type Functions = BTreeMap<String, (Vec<String>, String)>;

fn functions_of_the_code() -> Functions {
    let mut found = Functions::new();
    for file in std::fs::read_dir(here().join("src")).expect("sources") {
        let text = read(&file.expect("a file").path());
        for part in text.split("extern \"C\" fn ").skip(1) {
            let (name, rest) = part.split_once('(').expect("parameters");
            let (parameters, rest) = rest.split_once(')').expect("an end");
            let result = rest.split_once('{').expect("a body").0.trim().trim_start_matches("->").trim();
            let types = parameters.split(',').filter_map(|one| one.split_once(": "));
            let types = types.map(|(_, kind)| c_type(kind.trim())).collect();
            let result = if result.is_empty() { "void".to_owned() } else { c_type(result) };
            found.insert(name.to_owned(), (types, result));
        }
    }
    found
}

/// A declaration's type without the parameter's name and without spaces around the stars.
fn normal(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ").replace(" *", "*").replace("* ", "*")
}

fn functions_of_the_header() -> Functions {
    let text = read(&here().join("include/softtwin.h"));
    // Without comments: what follows the end of each.
    let text: String = text.split("/*").map(|part| part.rsplit("*/").next().unwrap_or(part)).collect();
    let (functions, _) = text.split_once("#define SOFTTWIN_READER_").expect("typed readers");
    let mut found = Functions::new();
    for declaration in functions.split(';') {
        let Some((head, parameters)) = declaration.split_once('(') else { continue };
        if declaration.contains(['{', '#', '}']) || !parameters.ends_with(')') {
            continue;
        }
        let at = head.rfind("softtwin_").expect("a name");
        let (result, name) = head.split_at(at);
        let parameters = parameters.trim_end_matches(')').split(',').filter(|one| *one != "void");
        let types = parameters.map(|one| {
            let at = one.rfind(|c: char| !c.is_alphanumeric() && c != '_').expect("a type") + 1;
            normal(&one[..at]).trim().to_owned()
        });
        found.insert(name.to_owned(), (types.collect(), normal(result).trim().to_owned()));
    }
    found
}

#[test]
fn the_header_declares_the_functions_of_the_code() {
    let (code, header) = (functions_of_the_code(), functions_of_the_header());
    assert!(code.len() >= 20, "the sources were not understood: {code:?}");
    assert_eq!(code, header);
}

#[test]
fn the_statuses_of_the_header_are_those_of_the_code() {
    let header = read(&here().join("include/softtwin.h"));
    let code = read(&here().join("src/ffi.rs"));
    let statuses: Vec<&str> = code
        .lines()
        .map(str::trim)
        .filter(|line| line.starts_with("SOFTTWIN_") && line.contains(" = "))
        .collect();
    assert_eq!(statuses.len(), 8);
    for status in statuses {
        assert!(header.contains(status.trim_end_matches(',')), "{status} is missing");
    }
}
