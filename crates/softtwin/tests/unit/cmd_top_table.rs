//! Tests of `src/cmd/top/table.rs` that need its private parts.

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

fn known<'a>(state: &'a State, health: &'a Health) -> Known<'a> {
    Known { state: Some(state), health: Some(health), ..Known::default() }
}

#[test]
fn row_fits_into_eighty_columns() {
    let row = row("finger", known(&state(), &health()), 1_001_000_000);
    let cells: Vec<&str> = row.split_whitespace().collect();
    assert_eq!(cells, ["finger", "1000", "61", "240", "1.0ms", "contact", "0.0450", "1.250", "3/1"]);
    assert!(row.len() <= 80 && head().len() <= 80, "{row}");
}

#[test]
fn grasp_has_a_separate_row() {
    let grasp = Grasp {
        grasp_status: grasp_status::HELD,
        least_force_n: 0.5862,
        needed_force_n: 0.4169,
        stop_pressure_mpa: 0.0651,
        stop_pressure_halfwidth_mpa: 0.0012,
        ..Grasp::default()
    };
    let row = grasp_row("gripper", &grasp);
    let lines: Vec<&str> = row.lines().collect();
    assert_eq!(lines[0], "gripper   grasp: held, 0.586 of 0.417 N per finger,");
    assert_eq!(lines[1], "                 first held at 0.06510 +- 0.00120 MPa");
}

#[test]
fn long_lines_are_wrapped_at_eighty_columns() {
    let mut estimate = Estimate { unknown_count: 3, ..Estimate::default() };
    ["gap_mm", "pressure_bias_mpa", "elastomer.law.mu_mpa"]
        .iter()
        .enumerate()
        .for_each(|(at, name)| estimate.set_name(at, name));
    let flags = flags::STALE | flags::HELD | flags::OUTSIDE_DOMAIN | flags::FORCE_MISMATCH;
    let state = State { flags, ..state() };
    let row = row("finger", known(&state, &health()), 60_000_000_000);
    for text in [row, estimate_row(&estimate)] {
        assert!(text.lines().count() > 1 && text.lines().all(|line| line.len() <= 80), "{text}");
        assert!(text.lines().all(|line| !line.ends_with(' ')), "{text}");
    }
}

#[test]
fn gone_twin_and_stale_state_are_marked() {
    let stale = State { flags: flags::STALE | flags::HELD, ..state() };
    let row = row("finger", known(&stale, &health()), 60_000_000_000);
    assert!(row.contains("gone stale held 3/1") && row.contains("59s"), "{row}");
}

#[test]
fn twin_without_data_has_a_row() {
    let row = row("finger", Known::default(), 60_000_000_000);
    assert!(row.contains("unknown") && row.contains("gone"), "{row}");
}
