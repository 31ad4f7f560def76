//! Actuator files made from the reference by changing values.
#![allow(dead_code, reason = "each test binary uses a part of it")]

use std::path::{Path, PathBuf};

/// A file among the committed models.
pub fn model(file: &str) -> PathBuf {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../models")).join(file)
}

/// The text of the reference actuator.
pub fn reference() -> String {
    std::fs::read_to_string(model("pneunet/actuator.toml")).unwrap()
}

/// Changes the value of a key within a section.
pub fn with(text: &str, section: &str, key: &str, value: &str) -> String {
    let at = text.find(&format!("[{section}]")).unwrap();
    let line = at + text[at..].find(&format!("\n{key} = ")).unwrap() + 1;
    let end = line + text[line..].find('\n').unwrap();
    format!("{}{key} = {value}{}", &text[..line], &text[end..])
}

/// The reference with another number of chambers; its mesh is `mesh.vtu`, of any size.
pub fn chambers(count: usize) -> String {
    let length = 9.0 * count as f64 + 4.0;
    let mut text = reference();
    for (section, key, value) in [
        ("chambers", "count", count.to_string()),
        ("body", "length_mm", format!("{length:.1}")),
        ("base", "length_mm", format!("{:.1}", length + 12.0)),
        ("mesh", "file", "\"mesh.vtu\"".into()),
        ("mesh", "nodes", "0".into()),
    ] {
        text = with(&text, section, key, &value);
    }
    text
}

/// Two chambers as wide as base and channels, so that a grid has few elements, and a solver that gives up early.
pub fn tiny() -> String {
    let mut text = chambers(2);
    for (section, key, value) in [
        ("base", "width_mm", "16.0"),
        ("body", "width_mm", "16.0"),
        ("chambers", "width_mm", "12.0"),
        ("channels", "width_mm", "12.0"),
        ("newton", "smallest_step", "0.2"),
        ("newton", "max_iterations", "10"),
    ] {
        text = with(&text, section, key, value);
    }
    text
}

/// The text with further keys in a section.
pub fn more(text: &str, section: &str, keys: &str) -> String {
    text.replacen(&format!("[{section}]"), &format!("[{section}]\n{keys}"), 1)
}

/// The text without a section.
pub fn without(text: &str, section: &str) -> String {
    let at = text.find(&format!("\n[{section}]")).unwrap() + 1;
    let end = at + 1 + text[at + 1..].find("\n[").unwrap();
    format!("{}{}", &text[..at], &text[end..])
}

/// Two-sided finger of two equal rows, without weight.
pub fn two_sided() -> String {
    let text = more(&tiny(), "chambers", "opposite = \"lower\"");
    let text = without(&with(&text, "loads", "gravity_mm_s2", "[0.0, 0.0, 0.0]"), "obstacle");
    format!("{text}\n[pressure_mpa]\nlower = 0.0\n")
}
