//! The tables of `docs/wire.md`, between markers.

use super::{Described, line};
use std::fmt::Write;
use wire::layout::{
    self, Codes, domain_status, estimate_alarm, estimate_status, field_id, flags, grasp_status, input_source,
    query_kind, regime, target_kind, value_bits, valve_interlock, valve_limit, valve_reason,
};
use wire::{Outcome, QueryStatus, TopicKind, qos};

/// The document with all tables from the definitions.
pub fn generated(page: &str, payloads: &[Described]) -> String {
    let mut page = page.to_owned();
    for (name, body) in [("settings", settings()), ("numbers", numbers()), ("payloads", tables(payloads))] {
        let begin = format!("<!-- generated: {name} -->\n");
        let end = "<!-- end of generated -->";
        let from = page.find(&begin).unwrap_or_else(|| panic!("`{begin}` is missing")) + begin.len();
        let to = from + page[from..].find(end).unwrap_or_else(|| panic!("{name} has no end"));
        page.replace_range(from..to, &format!("\n{body}\n"));
    }
    with_version(&page)
}

/// The text with the version of the definitions in every type name (`softtwin.State.v1`).
fn with_version(page: &str) -> String {
    let mut out = String::new();
    for (at, part) in page.split("`softtwin.").enumerate() {
        if at > 0 {
            out.push_str("`softtwin.");
        }
        match part.split_once(".v") {
            Some((name, rest)) if at > 0 && name.chars().all(char::is_alphanumeric) => {
                let rest = rest.trim_start_matches(|letter: char| letter.is_ascii_digit());
                write!(out, "{name}.v{}{rest}", layout::LAYOUT_VERSION).expect("memory");
            }
            _ => out.push_str(part),
        }
    }
    out
}

fn settings() -> String {
    let mut out = String::from(
        "| kind | subscribers = listeners | buffer | borrowed samples | history | nodes |\n\
         | --- | --- | --- | --- | --- | --- |\n",
    );
    for kind in TopicKind::ALL {
        let q = qos::of(kind);
        let cells = [q.max_readers, q.buffer, q.max_borrowed, q.history, q.max_nodes].map(|n| n.to_string());
        writeln!(out, "| {} | {} |", kind.as_str(), cells.join(" | ")).expect("memory");
    }
    write!(
        out,
        "\n`query`: {} clients, 1 server, {} nodes, {} active requests and loaned requests a client, response buffer 1,\n\
         borrowed responses 1, safe overflow both ways, no fire and forget. Its events: `query` 1 listener and {} notifiers,\n\
         `answer` {} listeners and 1 notifier.\n",
        qos::MAX_CLIENTS,
        qos::MAX_QUERY_NODES,
        qos::MAX_OPEN_QUESTIONS,
        qos::MAX_CLIENTS,
        qos::MAX_CLIENTS
    )
    .expect("memory");
    out
}

fn numbers() -> String {
    let mut out = String::new();
    let mut table = |title: &str, codes: Codes| {
        writeln!(out, "{title}\n\n| number | name | meaning |\n| --- | --- | --- |").expect("memory");
        for code in codes {
            writeln!(out, "| {} | {} | {} |", code.number, code.name, line(code.meaning)).expect("memory");
        }
        writeln!(out).expect("memory");
    };
    table("`flags`, bits:", flags::ALL);
    table("`stale_values`, `fault_values`, bits:", value_bits::ALL);
    table("`regime`:", regime::ALL);
    table("`domain_status`:", domain_status::ALL);
    table("`input_sources`:", input_source::ALL);
    table("`field_ids`:", field_id::ALL);
    table("`outcome`, and index of `outcomes`:", Outcome::CODES);
    table("`grasp_status`:", grasp_status::ALL);
    table("`status` of an estimate:", estimate_status::ALL);
    table("`alarm` of an estimate:", estimate_alarm::ALL);
    table("`target_kind`:", target_kind::ALL);
    table("`valve_reason`:", valve_reason::ALL);
    table("`valve_interlock`, bits:", valve_interlock::ALL);
    table("`valve_limit`, bits:", valve_limit::ALL);
    table("`kind` of a question:", query_kind::ALL);
    table("`status` of an answer; `{limit}` is the answer's `limit`:", QueryStatus::CODES);
    out.trim_end().to_owned() + "\n"
}

fn tables(payloads: &[Described]) -> String {
    let mut out = String::new();
    for described in payloads {
        let layout = described.layout;
        let meaning = line(layout.meaning);
        writeln!(out, "### `{}`, {} bytes\n\n{meaning}\n", layout.type_name, layout.size).expect("memory");
        out.push_str(
            "| offset | type | field | unit | absent | meaning |\n| --- | --- | --- | --- | --- | --- |\n",
        );
        for field in layout.fields {
            let count = if field.count > 1 { format!("[{}]", field.count) } else { String::new() };
            let absent = Some(described.absent(field)).filter(|absent| absent != "0").unwrap_or_default();
            writeln!(
                out,
                "| {} | {}{count} | `{}` | {} | {} | {} |",
                field.offset,
                field.scalar.as_str(),
                field.name,
                field.unit,
                absent,
                line(field.meaning)
            )
            .expect("memory");
        }
        out.push('\n');
    }
    out.trim_end().to_owned() + "\n"
}
