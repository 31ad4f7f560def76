//! Listings of nodal results as Ansys' `PRNSOL` prints them, and tables of the same form: a line `NODE` with the names of the
//! columns, then a line a node.
//!
//! `LOAD STEP=`, `SUBSTEP=` and `TIME=` above a listing say which state it belongs to; listings of one state may stand apart.

use super::groups::groups;
use super::run::{Quantity, Step};
use crate::error::Diagnostic;
use std::collections::HashMap;

/// Diagnostics after which reading stops.
const MAX_DIAGNOSTICS: usize = 20;
/// A quantity at less than one in so many nodes is passed over: memory stays linear in the text.
const SPARSE: usize = 16;
/// Whole numbers up to here are exact.
const MAX_LABEL: f64 = 9_007_199_254_740_992.0;

/// Reads a text; `labels` are the numbers of the mesh's nodes.
///
/// # Errors
/// Everything that is wrong, with line numbers; never empty.
pub fn parse(text: &str, labels: &[u64]) -> Result<Vec<Step>, Vec<Diagnostic>> {
    let place = labels.iter().enumerate().map(|(at, label)| (*label, at as u32)).collect();
    let mut reader = Reader { place, step: "step 1".into(), ..Reader::default() };
    for (number, line) in text.lines().enumerate() {
        reader.number = number + 1;
        reader.line(line.trim());
        if reader.diagnostics.len() >= MAX_DIAGNOSTICS {
            break;
        }
    }
    reader.finish(labels.len())
}

/// Rows of the columns that a line `NODE` named.
#[derive(Default)]
struct Listing {
    columns: Vec<String>,
    nodes: Vec<u32>,
    values: Vec<f64>,
}

#[derive(Default)]
struct State {
    name: String,
    time: Option<f64>,
    listings: Vec<Listing>,
}

#[derive(Default)]
struct Reader {
    place: HashMap<u64, u32>,
    states: Vec<State>,
    /// Position of each state by its name, and of its listings by their columns.
    known: HashMap<String, (usize, HashMap<Vec<String>, usize>)>,
    step: String,
    time: Option<f64>,
    /// State and listing that rows belong to.
    open: Option<(usize, usize)>,
    number: usize,
    diagnostics: Vec<Diagnostic>,
}

impl Reader {
    fn report(&mut self, expected: impl std::fmt::Display, found: impl std::fmt::Display) {
        let found: String = found.to_string().chars().take(80).collect();
        self.diagnostics.push(Diagnostic::new(format!("line {}", self.number), expected, found));
    }

    fn line(&mut self, line: &str) {
        let mut words = line.split_ascii_whitespace();
        let Some(first) = words.next() else { return };
        let after = |key: &str| {
            let rest = line.split_once(key)?.1;
            rest.split_ascii_whitespace().next()
        };
        if let Some(step) = after("LOAD STEP=") {
            self.step = format!("step {step} substep {}", after("SUBSTEP=").unwrap_or("1"));
            (self.time, self.open) = (None, None);
        } else if first.starts_with("TIME=") {
            self.time =
                after("TIME=").and_then(|time| time.parse().ok()).filter(|time: &f64| time.is_finite());
        } else if first.starts_with("FREQ=") {
            self.report("states of a static or transient solution", "a mode of vibration");
        } else if line.starts_with("THE FOLLOWING") && !line.contains("GLOBAL") {
            self.report("results in the global Cartesian system (RSYS,0 before PRNSOL)", line);
        } else if first.eq_ignore_ascii_case("NODE") && words.clone().all(|word| word.parse::<f64>().is_err())
        {
            self.header(words.map(str::to_owned).collect());
        } else if first.starts_with(|c: char| c.is_ascii_digit()) {
            self.row(line);
        } else {
            self.open = None;
        }
    }

    /// Rows follow, of the listing with these columns where the state has it already: pages repeat the header.
    fn header(&mut self, columns: Vec<String>) {
        if columns.is_empty() {
            return self.report("names of columns behind NODE", "none");
        }
        let states = self.states.len();
        let (state, listings) = self.known.entry(self.step.clone()).or_insert((states, HashMap::new()));
        if *state == states {
            self.states.push(State { name: self.step.clone(), ..State::default() });
        }
        let known = &mut self.states[*state];
        known.time = known.time.or(self.time);
        let listing = *listings.entry(columns.clone()).or_insert(known.listings.len());
        if listing == known.listings.len() {
            known.listings.push(Listing { columns, ..Listing::default() });
        }
        self.open = Some((*state, listing));
    }

    fn row(&mut self, line: &str) {
        let numbers = numbers(line);
        if numbers.is_none() && line.contains(|c: char| c.is_ascii_alphabetic() && !matches!(c, 'E' | 'e')) {
            // A title that begins with a digit.
            self.open = None;
            return;
        }
        let Some((state, listing)) = self.open else {
            return self.report("a line NODE with the names of the columns above the numbers", line);
        };
        let listing = &mut self.states[state].listings[listing];
        let count = listing.columns.len();
        let Some([label, values @ ..]) = numbers.as_deref().filter(|numbers| numbers.len() == count + 1)
        else {
            return self.report(format!("a node and {count} numbers"), line);
        };
        let whole = Some(*label).filter(|label| label.fract() == 0.0 && (0.0..MAX_LABEL).contains(label));
        let Some(node) = whole.and_then(|label| self.place.get(&(label as u64)).copied()) else {
            return self.report("a node of the mesh", label);
        };
        listing.nodes.push(node);
        listing.values.extend(values);
    }

    fn finish(mut self, nodes: usize) -> Result<Vec<Step>, Vec<Diagnostic>> {
        let mut steps = Vec::new();
        for state in std::mem::take(&mut self.states) {
            let mut step = Step { name: state.name, time: state.time, quantities: Vec::new() };
            for listing in &state.listings {
                if listing.nodes.len() * SPARSE >= nodes {
                    self.quantities(&mut step, listing, nodes);
                }
            }
            steps.push(step);
        }
        if self.diagnostics.is_empty() && steps.is_empty() {
            let expected = "listings of PRNSOL, or a line NODE with names of columns and a line a node";
            self.diagnostics.push(Diagnostic::new("file", expected, "none"));
        }
        if self.diagnostics.is_empty() { Ok(steps) } else { Err(self.diagnostics) }
    }

    /// Sorts the rows of a listing by node.
    fn quantities(&mut self, step: &mut Step, listing: &Listing, nodes: usize) {
        let columns = &listing.columns;
        let mut rows = vec![None; nodes];
        for (node, row) in listing.nodes.iter().zip(listing.values.chunks_exact(columns.len())) {
            if rows[*node as usize].replace(row).is_some() {
                let expected =
                    "every node once in a listing (/GRAPHICS,FULL before PRNSOL: means over materials)";
                let place = format!("{}, columns {}", step.name, columns.join(" "));
                return self.diagnostics.push(Diagnostic::new(place, expected, "one several times"));
            }
        }
        let all: Vec<usize> = (0..columns.len()).collect();
        for (name, group) in groups(&all, columns) {
            let value = |row: &Option<&[f64]>| -> Vec<f64> {
                group.iter().map(|at| row.map_or(f64::NAN, |row| row[*at])).collect()
            };
            let values = rows.iter().flat_map(value).collect();
            let components = group.iter().map(|at| columns[*at].clone()).collect();
            step.quantities.push(Quantity { name, components, values });
        }
    }
}

/// Numbers of a line, which may touch: `1-0.25E-01 0.5`. `None` where something else stands between them.
fn numbers(line: &str) -> Option<Vec<f64>> {
    let mut found = Vec::new();
    for word in line.split_ascii_whitespace() {
        let (bytes, mut from) = (word.as_bytes(), 0);
        for at in 1..=bytes.len() {
            let is_sign = at < bytes.len() && matches!(bytes[at], b'-' | b'+');
            if at == bytes.len() || is_sign && !matches!(bytes[at - 1], b'E' | b'e') {
                found.push(word.get(from..at)?.parse().ok().filter(|value: &f64| value.is_finite())?);
                from = at;
            }
        }
    }
    Some(found)
}
