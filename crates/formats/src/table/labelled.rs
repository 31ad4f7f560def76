//! Lines of serial monitors and of JSON as rows: `t:20,p:1.5`, `t=20ms P=1.5kPa`, `20 ms, P = 1.5 kPa`, `{"t": 20, "p": 1.5}`,
//! `10:12:13.1 -> 1.5,2`.

use super::lines;
use super::number::is_content;
use crate::unit;

/// Lines that decide whether the file has labels.
const PROBE: usize = 200;
/// Between the clock of a serial monitor and its line.
const ARROW: &str = " -> ";

/// The label of each column, and the text with tabs between the values; `None` unless most of the first lines have the same labels.
/// Lines without the labels are unchanged.
pub(super) fn rows(text: &str) -> Option<(Vec<String>, String)> {
    let all = || lines(text).map(|(_, place)| text[place].trim());
    let probe: Vec<Option<(Vec<String>, String)>> =
        all().filter(|line| is_content(line)).take(PROBE).map(row).collect();
    let votes = |labels: &[String]| probe.iter().flatten().filter(|(own, _)| own == labels).count();
    let (labels, _) = probe.iter().flatten().max_by_key(|(own, _)| votes(own))?;
    if 2 * votes(labels) <= probe.len() {
        return None;
    }
    let rewritten = |line: &str| {
        let values = row(line).filter(|(own, _)| own == labels).map(|(_, values)| values);
        // Headings behind the clock have none.
        let headings = || line.split_once(ARROW).map(|(_, rest)| format!("time\t{}", cells(rest).join("\t")));
        values.or_else(headings).unwrap_or_else(|| line.to_owned())
    };
    Some((labels.clone(), all().map(rewritten).collect::<Vec<_>>().join("\n")))
}

/// Labels and values of a line; `None` if it has neither labels nor a clock with an arrow.
fn row(line: &str) -> Option<(Vec<String>, String)> {
    let (clock, rest) = line.split_once(ARROW).map_or((None, line), |(clock, rest)| (Some(clock), rest));
    let cells = cells(rest);
    let labelled: Option<Vec<(String, &str)>> = cells.iter().map(|cell| label(cell)).collect();
    let pairs = match (labelled, clock) {
        (Some(pairs), _) => pairs,
        (None, Some(_)) if cells.iter().any(|cell| is_number(cell)) => {
            cells.into_iter().map(|cell| (String::new(), cell)).collect()
        }
        _ => return None,
    };
    let all = clock.map(|clock| ("time".to_owned(), clock)).into_iter().chain(pairs);
    let (labels, values): (Vec<String>, Vec<&str>) = all.unzip();
    Some((labels, values.join("\t")))
}

fn cells(rest: &str) -> Vec<&str> {
    let rest = rest.trim().trim_start_matches('{').trim_end_matches(['}', ',']).trim();
    let separator = [';', '\t', ','].into_iter().find(|separator| rest.contains(*separator));
    match separator {
        Some(separator) => rest.split(separator).map(str::trim).collect(),
        None => rest.split_whitespace().collect(),
    }
}

/// Name and value of `name:value` or `name=value`; a unit behind the value goes to the name, and may be all of it.
fn label(cell: &str) -> Option<(String, &str)> {
    let (name, value) = cell.split_once([':', '=']).unwrap_or(("", cell));
    let [name, value] = [name, value].map(|text| text.trim().trim_matches('"'));
    let (value, unit) = value.split_once(char::is_whitespace).or_else(|| glued(value)).unwrap_or((value, ""));
    let unit = unit.trim();
    let is_named =
        name.starts_with(char::is_alphabetic) || (name.is_empty() && !unit.is_empty() && is_number(value));
    let is_unit = unit.is_empty() || (is_number(value) && !unit.contains(char::is_whitespace));
    let name = if unit.is_empty() { name.to_owned() } else { format!("{name} [{unit}]").trim().to_owned() };
    (is_named && is_unit && !value.is_empty()).then_some((name, value))
}

/// Number and unit of `20ms`.
fn glued(value: &str) -> Option<(&str, &str)> {
    let begin = value.rfind(|c: char| c.is_ascii_digit() || c == '.')? + 1;
    let (number, spelling) = (&value[..begin], &value[begin..]);
    (is_number(number) && unit::unit(spelling).is_some()).then_some((number, spelling))
}

fn is_number(cell: &str) -> bool {
    cell.trim().replace(',', ".").parse::<f64>().is_ok()
}
