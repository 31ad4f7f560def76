//! Files generated from the definitions of the payloads: tables of `docs/wire.md`, the C header, the Python modules.
//! `BLESS=1 cargo test -p wire --test generated` writes all of them; without it an outdated file fails the test.

mod header;
mod page;
mod python;

use std::path::{Path, PathBuf};
use wire::layout::{Field, Layout, Number, Payload, View};
use wire::{
    Answer, Command, Estimate, FieldHeader, Grasp, Health, Query, SensorSample, Setpoint, State, Target,
    Valve,
};

/// A payload's description with its default.
struct Described {
    layout: &'static Layout,
    default: Vec<u8>,
}

impl Described {
    /// Value of a field if it is unknown.
    fn absent(&self, field: &Field) -> String {
        let view = View { layout: self.layout, bytes: &self.default };
        match view.numbers(field).next().expect("a value") {
            Number::Whole(number) => number.to_string(),
            Number::Single(number) => number.to_string(),
            Number::Double(number) => number.to_string(),
        }
    }
}

fn described() -> [Described; 12] {
    fn of<P: Payload>() -> Described {
        Described { layout: P::LAYOUT, default: P::default().view().bytes.to_vec() }
    }
    let all = [
        of::<SensorSample>(),
        of::<FieldHeader>(),
        of::<State>(),
        of::<Health>(),
        of::<Grasp>(),
        of::<Command>(),
        of::<Estimate>(),
        of::<Setpoint>(),
        of::<Target>(),
        of::<Valve>(),
        of::<Query>(),
        of::<Answer>(),
    ];
    assert!(all.iter().map(|one| one.layout).eq(wire::layout::PAYLOADS), "a payload is not generated");
    all
}

/// A meaning on one line.
fn line(meaning: &str) -> String {
    meaning.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// `FieldHeader` as `field_header`, `not held` as `not_held`.
fn snake(name: &str) -> String {
    let mut text = String::new();
    for letter in name.chars() {
        if letter.is_uppercase() && !text.is_empty() {
            text.push('_');
        }
        text.push(if letter.is_alphanumeric() { letter.to_ascii_lowercase() } else { '_' });
    }
    text
}

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Compares a committed file with what it should be, or writes it.
fn check(path: &str, generated: &str) {
    let file = repository().join(path);
    if std::env::var_os("BLESS").is_some() {
        std::fs::write(&file, generated).unwrap_or_else(|error| panic!("{path}: {error}"));
    }
    let committed = std::fs::read_to_string(&file).unwrap_or_default();
    assert!(
        committed == generated,
        "{path} is not what the definitions say; write it with `BLESS=1 cargo test -p wire --test generated`"
    );
}

#[test]
fn the_page_is_current() {
    let path = "docs/wire.md";
    let committed = std::fs::read_to_string(repository().join(path)).expect("the document");
    check(path, &page::generated(&committed, &described()));
}

#[test]
fn the_c_header_is_current() {
    check("crates/capi/include/softtwin_layout.h", &header::generated(&described()));
}

#[test]
fn the_python_modules_are_current() {
    check("clients/python/src/softtwin/layout.pyi", &python::layout(&described()));
}

/// Units in names and in definitions are the same.
#[test]
fn units_are_those_of_the_names() {
    let suffixes = [
        ("_n_per_mpa", "N/MPa"),
        ("_n_per_mm", "N/mm"),
        ("_per_s", "1/s"),
        ("_mpa", "MPa"),
        ("_mm", "mm"),
        ("_n", "N"),
        ("_ns", "ns"),
        ("_s", "s"),
        ("_hz", "Hz"),
        ("_kg", "kg"),
    ];
    for described in described() {
        for field in described.layout.fields {
            let unit =
                suffixes.iter().find(|(suffix, _)| field.name.ends_with(suffix)).map_or("", |(_, unit)| unit);
            assert_eq!(field.unit, unit, "{}.{}", described.layout.name, field.name);
        }
    }
}
