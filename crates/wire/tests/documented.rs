//! The page that documents the wire says what the code does: every offset, type, size and setting.

use std::path::Path;
use wire::layout::{Described, FIELD_SLOTS, flags};
use wire::{Answer, Command, FieldHeader, Grasp, Health, Query, SensorSample, State, TopicKind, layout, qos};

fn page() -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/wire.md");
    std::fs::read_to_string(path).expect("docs/wire.md")
}

/// Bytes of a type as the page writes it: `u32`, `f32[64]`.
fn bytes(text: &str) -> usize {
    let (element, count) = text.trim_end_matches(']').split_once('[').unwrap_or((text, "1"));
    let size = match element {
        "u8" => 1,
        "u32" | "f32" => 4,
        "u64" | "f64" => 8,
        other => panic!("`{other}` is no type of the page"),
    };
    size * count.parse::<usize>().expect("a count")
}

fn check<T: Described>(page: &str) {
    let title = format!("### `{}`, {} bytes", T::type_name(), T::SIZE);
    let section = page.split(&title).nth(1).unwrap_or_else(|| panic!("`{title}` is missing"));
    let section = section.split("\n### ").next().expect("a section");
    let rows: Vec<Vec<&str>> = section
        .lines()
        .filter(|line| line.starts_with("| ") && line.as_bytes()[2].is_ascii_digit())
        .map(|line| line.trim_matches('|').split(" | ").map(str::trim).collect())
        .collect();
    assert_eq!(rows.len(), T::FIELDS.len(), "{title}: rows");
    let ends = T::FIELDS.iter().skip(1).map(|(_, offset)| *offset).chain([T::SIZE]);
    for ((row, (name, offset)), end) in rows.iter().zip(T::FIELDS).zip(ends) {
        assert_eq!(row[0], offset.to_string(), "{title}: {name}");
        assert_eq!(row[2], format!("`{name}`"), "{title}");
        assert_eq!(offset + bytes(row[1]), end, "{title}: {name} leaves a hole or overlaps");
        assert!(row[3].len() > 4, "{title}: {name} has no meaning");
    }
}

#[test]
fn every_offset_is_documented_as_it_is() {
    let page = page();
    check::<SensorSample>(&page);
    check::<FieldHeader>(&page);
    check::<State>(&page);
    check::<Health>(&page);
    check::<Grasp>(&page);
    check::<Command>(&page);
    check::<Query>(&page);
    check::<Answer>(&page);
    assert_eq!(FIELD_SLOTS, 16);
}

#[test]
fn every_setting_is_documented_as_it_is() {
    let page = page();
    for kind in [
        TopicKind::Sensor,
        TopicKind::Field,
        TopicKind::State,
        TopicKind::Health,
        TopicKind::Grasp,
        TopicKind::Command,
    ] {
        let q = qos::of(kind);
        let row = format!(
            "| {} | {} | {} | {} | {} | {} |",
            kind.as_str(),
            q.max_readers,
            q.buffer,
            q.max_borrowed,
            q.history,
            q.max_nodes
        );
        assert!(page.contains(&row), "`{row}` is missing");
    }
    let query = format!(
        "`query`: {} clients, 1 server, {} nodes, {} active requests",
        qos::MAX_CLIENTS,
        qos::MAX_QUERY_NODES,
        qos::MAX_OPEN_QUESTIONS
    );
    assert!(page.contains(&query), "`{query}` is missing");
    let names: Vec<&str> = flags::NAMES.iter().map(|(_, name)| *name).collect();
    let flat = page.replace("\n ", "");
    assert!(flat.contains(&names.join(", ")), "the flags are not those of the page: {names:?}");
    for (bit, (flag, name)) in flags::NAMES.iter().enumerate() {
        assert_eq!(*flag, 1 << bit, "{name} is not at its place");
    }
    assert!(page.contains(&format!("The layout version, {},", layout::VERSION)));
}
