//! The rows of the table, and the same as JSON.

use crate::live;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use wire::layout::{flags, input_source, regime};
use wire::{AnySample, Estimate, Grasp, Health, Outcome, State};

/// Latest data of one twin.
#[derive(Clone, Copy, Default)]
pub struct Known<'a> {
    /// Its newest state.
    pub state: Option<&'a State>,
    /// Its newest health.
    pub health: Option<&'a Health>,
    /// Its newest estimate.
    pub estimate: Option<&'a Estimate>,
}

impl Known<'_> {
    fn regime(&self) -> &'static str {
        regime::as_str(self.state.map_or(regime::UNKNOWN, |state| state.regime))
    }
}

/// Health comes once a second; after so long without, the twin is gone.
const GONE_NS: u64 = 3_000_000_000;

/// Columns that a line of the table may have.
const WIDTH: usize = 80;

/// Pieces behind a head, in lines of at most [`WIDTH`] columns that begin where the head ends.
fn packed<'a>(head: String, pieces: impl IntoIterator<Item = &'a str>, gap: &str) -> String {
    let indent = head.chars().count();
    let (mut text, mut used) = (head, indent);
    for piece in pieces {
        let columns = piece.chars().count();
        if used > indent && used + gap.len() + piece.trim_end().chars().count() > WIDTH {
            text = format!("{}\n{:indent$}", text.trim_end(), "");
            used = indent;
        }
        let gap = if used > indent { gap } else { "" };
        text.extend([gap, piece]);
        used += gap.len() + columns;
    }
    text
}

/// The names of the columns.
pub fn head() -> String {
    format!(
        "{:<10}{:>5}{:>6}{:>7}{:>7} {:<7}{:>7}{:>7}  {}",
        "ACTUATOR", "Hz", "P50us", "P99us", "AGE", "REGIME", "P/MPa", "F/N", "FLAGS, HELD/DROP"
    )
}

/// One line of the table: 58 columns, and 22 for what is wrong; more lines where that is too much.
pub fn row(name: &str, known: Known<'_>, now: u64) -> String {
    let Known { state, health, .. } = known;
    let number = |value: Option<f64>, digits: usize| match value {
        Some(value) if value.is_finite() => format!("{value:.digits$}"),
        _ => "-".into(),
    };
    let micros = |ns: Option<u64>| number(ns.map(|ns| ns as f64 * 1e-3), 0);
    let mut notes: Vec<String> =
        flags::names(state.map_or(0, |state| state.flags)).map(str::to_owned).collect();
    if is_gone(state, health, now) {
        notes.insert(0, "gone".into());
    }
    let (held, dropped) = health.map_or((0, 0), faults);
    if held + dropped > 0 {
        notes.push(format!("{held}/{dropped}"));
    }
    let age_ns =
        state.filter(|state| state.t_sensor_ns > 0).map(|state| now.saturating_sub(state.t_sensor_ns));
    let head = format!(
        "{name:<9.9} {:>5}{:>6}{:>7}{:>7} {:<7}{:>7}{:>7}  ",
        number(health.map(|health| health.rate_hz), 0),
        micros(health.map(|health| health.latency_p50_ns)),
        micros(health.map(|health| health.latency_p99_ns)),
        age_ns.map_or("-".into(), age),
        known.regime(),
        number(state.map(|state| state.pressure_mpa), 4),
        number(state.map(|state| state.contact_force_n), 3),
    );
    packed(head, notes.iter().map(String::as_str), " ")
}

/// Lines of a twin's estimates.
pub fn estimate_row(estimate: &Estimate) -> String {
    packed("          ".into(), live::text::estimates(estimate).split("  "), "  ")
}

/// The values of a model's parameters, below the twin; none without parameters.
pub fn parameter_row(state: &State) -> Option<String> {
    let text = live::text::parameters(state.inputs());
    (!text.is_empty()).then(|| packed("          ".into(), text.trim_start().split("  "), "  "))
}

/// A grasp, below the fingers.
pub fn grasp_row(scene: &str, grasp: &Grasp) -> String {
    packed(format!("{scene:<9.9} grasp: "), live::text::grasp(grasp).split_inclusive(", "), "")
}

/// Whether nothing has been published for [`GONE_NS`].
fn is_gone(state: Option<&State>, health: Option<&Health>, now: u64) -> bool {
    let last_ns = state.map(|state| state.t_publish_ns).max(health.map(|health| health.t_publish_ns));
    now.saturating_sub(last_ns.unwrap_or(0)) > GONE_NS
}

/// Readings held and dropped since the start. Superseded ones are left out: a burst always has some.
fn faults(health: &Health) -> (u64, u64) {
    let sum =
        |pick: fn(&Outcome) -> bool| Outcome::ALL.iter().filter(|o| pick(o)).map(|o| health.count(*o)).sum();
    (
        sum(|outcome| outcome.is_held()),
        sum(|outcome| outcome.is_dropped() && *outcome != Outcome::DroppedSuperseded),
    )
}

/// A time span in a unit in which it is short.
fn age(ns: u64) -> String {
    match ns {
        0..10_000_000 => format!("{:.1}ms", ns as f64 * 1e-6),
        10_000_000..10_000_000_000 => format!("{}ms", ns / 1_000_000),
        _ => format!("{}s", ns / 1_000_000_000),
    }
}

/// Data of a twin as JSON.
pub fn json(name: &str, known: Known<'_>, now: u64) -> Value {
    let Known { state, health, estimate, .. } = known;
    let counts = health
        .iter()
        .flat_map(|health| Outcome::ALL.iter().map(|outcome| (outcome.as_str(), health.count(*outcome))));
    json!({
        "actuator": name,
        "alive": !is_gone(state, health, now),
        "rate_hz": health.map(|health| health.rate_hz),
        "latency_p50_us": health.map(|health| health.latency_p50_ns as f64 * 1e-3),
        "latency_p99_us": health.map(|health| health.latency_p99_ns as f64 * 1e-3),
        "age_ms": state.map(|state| now.saturating_sub(state.t_sensor_ns) as f64 * 1e-6),
        "regime": state.map(|_| known.regime()),
        "pressure_mpa": state.map(|state| state.pressure_mpa),
        "gap_mm": state.map(|state| state.gap_mm),
        "contact_force_n": state.map(|state| state.contact_force_n),
        "inputs": state.map(|state| state.inputs().map(|input| (input.name, input.value)).collect::<BTreeMap<_, _>>()),
        "input_sources": state.map(|state| {
            let named = state.inputs().map(|input| (input.name, input_source::as_str(input.source)));
            named.collect::<BTreeMap<_, _>>()
        }),
        "flags": flags::names(state.map_or(0, |state| state.flags)).collect::<Vec<_>>(),
        "received": health.map(|health| health.received),
        "missed": health.map(|health| health.missed),
        "estimate": estimate.and_then(|estimate| live::sample_json(&AnySample::Estimate(*estimate)).ok()),
        "outcomes": counts.collect::<BTreeMap<_, _>>(),
    })
}

#[cfg(test)]
#[path = "../../../tests/unit/cmd_top_table.rs"]
mod tests;
