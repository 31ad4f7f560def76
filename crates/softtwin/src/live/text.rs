//! Samples as one line for people.

use super::sample::range;
use wire::layout::{field_id, flags, grasp_status, regime};
use wire::{Command, FieldSample, Grasp, Health, Outcome, SensorSample, State, now_ns};

pub(super) fn sensor(sample: &SensorSample) -> String {
    let status = if sample.status == 0 { String::new() } else { format!("  FAULT {}", sample.status) };
    let force = optional("  measured", sample.measured_force_n, "N");
    format!(
        "#{:<7} P {:8.5} MPa  gap {:6.2} mm{force}  age {}{status}",
        sample.seq,
        sample.pressure_mpa,
        sample.gap_mm,
        ms(now_ns().saturating_sub(sample.t_sensor_ns))
    )
}

pub(super) fn state(state: &State) -> String {
    let bar = if state.force_halfwidth_n.is_nan() {
        String::new()
    } else {
        format!(" +- {:.4}", state.force_halfwidth_n)
    };
    format!(
        "#{:<7} P {:8.5} MPa  gap {:6.2} mm  {:7}  F {:7.4}{bar} N{}{}{}  age {}{}{}",
        state.seq,
        state.pressure_mpa,
        state.gap_mm,
        regime::as_str(state.regime),
        state.contact_force_n,
        optional("  dF/dP", state.force_by_pressure_n_per_mpa, "N/MPa"),
        optional("  dF/dgap", state.force_by_gap_n_per_mm, "N/mm"),
        optional("  measured", state.measured_force_n, "N"),
        ms(state.age_ns),
        flag_list(state.flags),
        Outcome::from_code(state.outcome)
            .filter(|outcome| *outcome != Outcome::Published)
            .map(|outcome| format!("  ({outcome})"))
            .unwrap_or_default(),
    )
}

pub(super) fn health(health: &Health) -> String {
    let bad: Vec<String> = Outcome::ALL
        .iter()
        .filter(|outcome| **outcome != Outcome::Published && health.count(**outcome) > 0)
        .map(|outcome| format!("{} {outcome}", health.count(*outcome)))
        .collect();
    format!(
        "{:7.1} Hz  latency p50 {} p99 {} max {}  {} received, {} published{}{}, {} never arrived{}",
        health.rate_hz,
        us(health.latency_p50_ns),
        us(health.latency_p99_ns),
        us(health.latency_max_ns),
        health.received,
        health.count(Outcome::Published),
        if bad.is_empty() { "" } else { ", " },
        bad.join(", "),
        health.missed,
        flag_list(health.flags),
    )
}

pub(super) fn field(sample: &FieldSample) -> String {
    let header = sample.header();
    let ranges: Vec<String> = header
        .fields()
        .filter_map(|id| {
            let (min, max) = range(sample.field(id)?);
            Some(format!("{} {min:.3}..{max:.3}", field_id::as_str(id)))
        })
        .collect();
    format!(
        "#{:<7} P {:8.5} MPa  {:7}  F {:7.4} N  {} nodes  {}{}",
        header.seq,
        header.pressure_mpa,
        regime::as_str(header.regime),
        header.contact_force_n,
        header.node_count,
        ranges.join("  "),
        flag_list(header.flags),
    )
}

pub(super) fn grasp(grasp: &Grasp) -> String {
    let forces: Vec<String> = grasp.fingers().map(|(force, _)| format!("{force:.4}")).collect();
    let stop = match grasp.stop_pressure_mpa {
        stop if stop.is_nan() => "no sampled pressure holds it".to_owned(),
        stop => format!("held from {stop:.5} +- {:.5} MPa on", grasp.stop_pressure_bar_mpa),
    };
    format!(
        "#{:<7} {}  F {} N, {:.4} N each needed for {:.1} g at friction {:.2}, safety {:.2}  margin {:+.0} %  {stop}{}",
        grasp.seq,
        grasp_status::as_str(grasp.verdict),
        forces.join(" "),
        grasp.needed_force_n,
        grasp.mass_kg * 1e3,
        grasp.friction,
        grasp.safety,
        grasp.margin * 100.0,
        flag_list(grasp.flags),
    )
}

pub(super) fn command(command: &Command) -> String {
    format!("#{:<7} P wanted {:8.5} MPa", command.seq, command.pressure_mpa)
}

fn optional(label: &str, value: f64, unit: &str) -> String {
    if value.is_nan() { String::new() } else { format!("{label} {value:.4} {unit}") }
}

fn flag_list(bits: u32) -> String {
    let names: Vec<&str> = flags::names(bits).collect();
    if names.is_empty() { String::new() } else { format!("  [{}]", names.join(" ")) }
}

fn ms(ns: u64) -> String {
    format!("{:.2} ms", ns as f64 / 1e6)
}

/// Nanoseconds as microseconds.
fn us(ns: u64) -> String {
    format!("{:.0} us", ns as f64 / 1e3)
}
