//! The rows of the table, and the same as JSON.

use crate::live;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use wire::layout::{flags, regime};
use wire::{Grasp, Health, Outcome, State};

/// Health comes once a second; after so long without, the twin is gone.
const GONE_NS: u64 = 3_000_000_000;

/// The names of the columns.
pub fn head() -> String {
    format!(
        "{:<14}{:>7}{:>7}{:>8}{:>8} {:<8}{:>8}{:>8}  {}",
        "ACTUATOR", "RATE", "P50us", "P99us", "AGE", "REGIME", "P/MPa", "F/N", "FLAGS, HELD/DROP"
    )
}

/// One line of the table; 80 columns for a healthy twin.
pub fn row(name: &str, state: Option<&State>, health: Option<&Health>, now: u64) -> String {
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
    format!(
        "{name:<14.14}{:>7}{:>7}{:>8}{:>8} {:<8}{:>8}{:>8}  {}",
        number(health.map(|health| health.rate_hz), 0),
        micros(health.map(|health| health.latency_p50_ns)),
        micros(health.map(|health| health.latency_p99_ns)),
        age_ns.map_or("-".into(), age),
        regime::as_str(state.map_or(regime::UNKNOWN, |state| state.regime)),
        number(state.map(|state| state.pressure_mpa), 4),
        number(state.map(|state| state.contact_force_n), 3),
        notes.join(" ")
    )
}

/// One line for a grasp, below the fingers.
pub fn grasp_row(scene: &str, grasp: &Grasp) -> String {
    format!("{scene:<14.14} grasp: {}", live::text::grasp(grasp))
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

/// What is known of a twin, for programs.
pub fn json(name: &str, state: Option<&State>, health: Option<&Health>, now: u64) -> Value {
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
        "regime": state.map(|state| regime::as_str(state.regime)),
        "pressure_mpa": state.map(|state| state.pressure_mpa),
        "gap_mm": state.map(|state| state.gap_mm),
        "contact_force_n": state.map(|state| state.contact_force_n),
        "flags": flags::names(state.map_or(0, |state| state.flags)).collect::<Vec<_>>(),
        "received": health.map(|health| health.received),
        "missed": health.map(|health| health.missed),
        "outcomes": counts.collect::<BTreeMap<_, _>>(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::layout::grasp_status;

    fn state() -> State {
        State {
            t_sensor_ns: 1_000_000_000,
            t_publish_ns: 1_000_100_000,
            pressure_mpa: 0.045,
            contact_force_n: 1.25,
            regime: regime::CONTACT,
            flags: 0,
            ..State::default()
        }
    }

    fn health() -> Health {
        let mut health = Health {
            rate_hz: 999.6,
            latency_p50_ns: 61_000,
            latency_p99_ns: 240_400,
            t_publish_ns: 1_000_000_000,
            ..Health::default()
        };
        health.outcomes[Outcome::HeldAbsurd.code() as usize] = 3;
        health.outcomes[Outcome::DroppedDuplicate.code() as usize] = 1;
        health.outcomes[Outcome::DroppedSuperseded.code() as usize] = 50;
        health
    }

    #[test]
    fn a_row_fits_into_eighty_columns() {
        let row = row("finger", Some(&state()), Some(&health()), 1_001_000_000);
        let cells: Vec<&str> = row.split_whitespace().collect();
        assert_eq!(cells, ["finger", "1000", "61", "240", "1.0ms", "contact", "0.0450", "1.250", "3/1"]);
        assert!(row.len() <= 80 && head().len() <= 90, "{row}");
    }

    #[test]
    fn a_grasp_has_a_row_of_its_own() {
        let grasp = Grasp {
            grasp_status: grasp_status::HELD,
            least_force_n: 0.5862,
            needed_force_n: 0.4169,
            stop_pressure_mpa: 0.0651,
            stop_pressure_halfwidth_mpa: 0.0012,
            ..Grasp::default()
        };
        let row = grasp_row("gripper", &grasp);
        assert_eq!(
            row,
            "gripper        grasp: held, 0.586 of 0.417 N a finger, first held at 0.06510 +- 0.00120 MPa"
        );
    }

    #[test]
    fn a_twin_that_is_gone_and_a_stale_state_are_marked() {
        let stale = State { flags: flags::STALE | flags::HELD, ..state() };
        let row = row("finger", Some(&stale), Some(&health()), 60_000_000_000);
        assert!(row.contains("gone stale held 3/1") && row.contains("59s"), "{row}");
    }

    #[test]
    fn a_twin_of_which_nothing_is_known_has_a_row() {
        let row = row("finger", None, None, 60_000_000_000);
        assert!(row.contains("unknown") && row.contains("gone"), "{row}");
    }
}
