//! Result of a soak test, and the missed bounds.

use super::observe::{DISTURBED, Row, STEADY, Usage};
use crate::slope::Slope;
use crate::stats::median;
use crate::verify::Counts;
use anyhow::Context;
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;

/// The programs of a row, in its order.
const PROGRAMS: [&str; 3] = ["twin", "bridge", "recorder"];
/// The first tenth of the rows is warm-up: pages are touched as samples first travel through them.
const WARM_UP: f64 = 0.1;
/// The smallest growth over the whole run that its slope must show with confidence to count as a leak: memory, kB (the allocator keeps
/// what a burst needed), and files.
const LEAK_KB: f64 = 64.0;
const LEAK_FILES: f64 = 1.0;
/// Outcomes of readings that are not wrong: a newer reading replaced an older one.
const HARMLESS: [&str; 2] = ["published", "dropped: superseded"];

/// Medians of the first and the last tenth, and the largest value: a moment's backlog is no leak, and a leak shows in both.
type BeginEndMax = [f64; 3];

/// The result.
#[derive(Debug, Serialize)]
pub struct Summary {
    faults: BTreeMap<&'static str, u64>,
    readers_come_and_gone: usize,
    recorded_messages: u64,
    lost_in_recorder: u64,
    verified: BTreeMap<&'static str, Counts>,
    unusual_outcomes_steady: BTreeMap<String, u64>,
    begin_end_max: BTreeMap<String, BeginEndMax>,
    /// Growth from one row to the next.
    slopes: BTreeMap<String, Slope>,
    latency_p50_us_first_and_second_half: [f64; 2],
    latency_p99_us_first_and_second_half: [f64; 2],
    /// Missed bounds; empty for a passed test.
    pub wrong: Vec<String>,
}

impl Summary {
    /// Sums up observations, the recorder's report, what readers verified, and the faults that were made.
    pub fn new(
        rows: &[Row],
        record: &Value,
        verified: BTreeMap<&'static str, Counts>,
        faults: BTreeMap<&'static str, u64>,
        readers: usize,
    ) -> anyhow::Result<Self> {
        let warm_up = ((rows.len() as f64 * WARM_UP) as usize).max(1).min(rows.len().saturating_sub(1));
        let settled = &rows[warm_up..];
        let number =
            |key: &str| record[key].as_u64().with_context(|| format!("the recorder reports no {key}"));
        let messages = record["messages"].as_object().context("the recorder reports no messages")?;
        let mut summary = Self {
            faults,
            readers_come_and_gone: readers,
            recorded_messages: messages.values().filter_map(Value::as_u64).sum(),
            lost_in_recorder: number("missing")? + number("dropped")?,
            verified,
            unusual_outcomes_steady: unusual(rows),
            begin_end_max: columns(settled, begin_end_max),
            slopes: columns(settled, slope)
                .into_iter()
                .filter_map(|(name, slope)| Some((name, slope?)))
                .collect(),
            latency_p50_us_first_and_second_half: halves(settled, "latency_p50_us"),
            latency_p99_us_first_and_second_half: halves(settled, "latency_p99_us"),
            wrong: Vec::new(),
        };
        summary.wrong = summary.find_wrong(record);
        Ok(summary)
    }

    fn find_wrong(&self, record: &Value) -> Vec<String> {
        let mut wrong = Vec::new();
        if self.lost_in_recorder > 0 {
            wrong.push(format!("{} samples lost in the recorder", self.lost_in_recorder));
        }
        for (topic, reason) in record["errors"].as_object().into_iter().flatten() {
            wrong.push(format!("{topic} was not recorded at the end: {reason}"));
        }
        for name in [STEADY, DISTURBED] {
            let counts = self.verified.get(name).copied().unwrap_or_default();
            if !counts.all_correct() || counts.fields_checked == 0 {
                wrong.push(format!("{name}: {counts:?}"));
            }
        }
        if !self.unusual_outcomes_steady.is_empty() {
            wrong.push(format!("unusual outcomes {:?}", self.unusual_outcomes_steady));
        }
        for (name, slope) in &self.slopes {
            let smallest = match name.rsplit_once('.').map_or(name.as_str(), |(_, what)| what) {
                "resident_kb" | "private_kb" => LEAK_KB,
                "threads" => f64::INFINITY,
                _ => LEAK_FILES,
            };
            if slope.grows(slope.points as f64, smallest) {
                wrong.push(format!("{name} grows: {slope:?} a row, {} rows", slope.points));
            }
        }
        wrong
    }
}

/// Name and value of what a program uses.
type UsageQuantity = (&'static str, fn(&Usage) -> u64);

fn begin_end_max(values: &[f64]) -> BeginEndMax {
    let tenth = (values.len() / 10).max(1).min(values.len());
    let (begin, end) = (&values[..tenth], &values[values.len() - tenth..]);
    let largest = values.iter().copied().fold(0.0, f64::max);
    [median(begin.iter().copied()), median(end.iter().copied()), largest]
}

fn slope(values: &[f64]) -> Option<Slope> {
    Slope::of(&(0..).map(f64::from).zip(values.iter().copied()).collect::<Vec<_>>())
}

/// Result of `make` per quantity.
fn columns<T>(rows: &[Row], make: impl Fn(&[f64]) -> T) -> BTreeMap<String, T> {
    let column = |of: &dyn Fn(&Row) -> u64| {
        let values: Vec<f64> = rows.iter().map(|row| of(row) as f64).collect();
        make(&values)
    };
    let mut growth = BTreeMap::from([
        ("shared_memory_files".to_owned(), column(&|row| row.shared_memory_files)),
        ("management_files".to_owned(), column(&|row| row.management_files)),
    ]);
    let quantities: [UsageQuantity; 4] = [
        ("resident_kb", |usage| usage.resident_kb),
        ("private_kb", |usage| usage.private_kb),
        ("open_files", |usage| usage.open_files),
        ("threads", |usage| usage.threads),
    ];
    for (p, program) in PROGRAMS.iter().enumerate() {
        for (name, of) in quantities {
            growth.insert(format!("{program}.{name}"), column(&|row| of(&row.programs[p])));
        }
    }
    growth
}

fn steady(row: &Row) -> impl Iterator<Item = &Value> {
    row.top.iter().filter(|twin| twin["actuator"] == STEADY)
}

/// Outcomes of the steady twin's readings in the last report.
fn unusual(rows: &[Row]) -> BTreeMap<String, u64> {
    let last = rows.iter().rev().find_map(|row| steady(row).next());
    let outcomes = last.and_then(|twin| twin["outcomes"].as_object()).into_iter().flatten();
    outcomes
        .filter_map(|(name, count)| Some((name.clone(), count.as_u64()?)))
        .filter(|(name, count)| *count > 0 && !HARMLESS.contains(&name.as_str()))
        .collect()
}

/// Medians of the first and the second half.
fn halves(rows: &[Row], key: &str) -> [f64; 2] {
    let values: Vec<f64> = rows.iter().flat_map(steady).filter_map(|twin| twin[key].as_f64()).collect();
    let (first, second) = values.split_at(values.len() / 2);
    [first, second].map(|half| median(half.iter().copied()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn row(kb: u64, files: u64) -> Row {
        let usage = Usage { resident_kb: kb, private_kb: kb, open_files: files, threads: 3 };
        let outcomes = json!({ "published": 5, "dropped: superseded": 1, "held: stale": 0 });
        let top = vec![json!({ "actuator": STEADY, "outcomes": outcomes, "latency_p50_us": 60.0 })];
        Row { programs: [usage; 3], shared_memory_files: files, management_files: 9, top }
    }

    fn summary(rows: &[Row], missing: u64) -> Summary {
        let record = json!({ "missing": missing, "dropped": 0, "errors": {}, "messages": { "a": 7 } });
        let counts = Counts { fields_checked: 1, states_checked: 1, ..Counts::default() };
        let verified = BTreeMap::from([(STEADY, counts), (DISTURBED, counts)]);
        Summary::new(rows, &record, verified, BTreeMap::new(), 3).expect("complete")
    }

    #[test]
    fn growth_loss_and_wrong_samples_are_named() {
        let quiet: Vec<Row> = (0..40).map(|_| row(5000, 20)).collect();
        assert_eq!(summary(&quiet, 0).wrong, Vec::<String>::new());
        assert!(summary(&quiet, 2).wrong[0].contains("2 samples lost"));
        let leaking: Vec<Row> = (0..40).map(|k| row(5000 + 100 * k, 20 + k)).collect();
        let wrong = summary(&leaking, 0).wrong.join("; ");
        for name in ["twin.resident_kb", "recorder.private_kb", "bridge.open_files", "shared_memory_files"] {
            assert!(wrong.contains(name), "{name} is not in {wrong}");
        }
        assert!(!wrong.contains("threads") && !wrong.contains("management_files"), "{wrong}");
    }
}
