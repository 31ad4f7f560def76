//! Lines of serial monitors and of JSON as rows: `t:20,p:1.5`, `{"t": 20, "p": 1.5}`, `10:12:13.1 -> 1.5,2`.

use super::cell::is_content;

/// Lines that decide whether the file has labels.
const PROBE: usize = 200;
/// Between the clock of a serial monitor and its line.
const ARROW: &str = " -> ";

/// Lines of a file with labels.
pub(super) struct Labelled {
    /// Label of each column.
    pub labels: Vec<String>,
    /// Number and text of each line, tabs between the values; lines without the labels are unchanged.
    pub lines: Vec<(usize, String)>,
}

/// The lines as rows; `None` unless most of the first lines have the same labels.
pub(super) fn rows(lines: &[(usize, &str)]) -> Option<Labelled> {
    let content = || lines.iter().filter(|(_, line)| is_content(line));
    let probe: Vec<Option<(Vec<&str>, String)>> = content().take(PROBE).map(|(_, line)| row(line)).collect();
    let votes = |labels: &[&str]| probe.iter().flatten().filter(|(own, _)| own == labels).count();
    let (labels, _) = probe.iter().flatten().max_by_key(|(own, _)| votes(own))?;
    if 2 * votes(labels) <= probe.len() {
        return None;
    }
    let one = |(number, line): &(usize, &str)| {
        let values = row(line).filter(|(own, _)| own == labels).map(|(_, values)| values);
        // Headings behind the clock have none.
        let headings = || line.split_once(ARROW).map(|(_, rest)| format!("time\t{}", cells(rest).join("\t")));
        (*number, values.or_else(headings).unwrap_or_else(|| (*line).to_owned()))
    };
    let lines = lines.iter().map(one).collect();
    Some(Labelled { labels: labels.iter().map(|label| (*label).to_owned()).collect(), lines })
}

/// Labels and values of a line; `None` if it has neither labels nor a clock with an arrow.
fn row(line: &str) -> Option<(Vec<&str>, String)> {
    let (clock, rest) = line.split_once(ARROW).map_or((None, line), |(clock, rest)| (Some(clock), rest));
    let cells = cells(rest);
    let labelled: Option<Vec<(&str, &str)>> = cells.iter().map(|cell| label(cell)).collect();
    let is_number = |cell: &&str| cell.trim().replace(',', ".").parse::<f64>().is_ok();
    let pairs = match (labelled, clock) {
        (Some(pairs), _) => pairs,
        (None, Some(_)) if cells.iter().any(is_number) => cells.into_iter().map(|cell| ("", cell)).collect(),
        _ => return None,
    };
    let all = clock.map(|clock| ("time", clock)).into_iter().chain(pairs);
    let (labels, values): (Vec<&str>, Vec<&str>) = all.unzip();
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

/// Name and value of `name:value` or `name=value`.
fn label(cell: &str) -> Option<(&str, &str)> {
    let (name, value) = cell.split_once([':', '='])?;
    let [name, value] = [name, value].map(|text| text.trim().trim_matches('"'));
    (name.starts_with(char::is_alphabetic) && !value.is_empty()).then_some((name, value))
}
