//! Samples and answers as one line, for all commands and the web viewer.

use wire::layout::{
    InputValue, estimate_alarm, estimate_status, field_id, flags, grasp_status, input_source, query_kind,
    regime, target_kind, unpack_name, value_bits, valve_interlock, valve_limit, valve_reason,
};
use wire::{
    Answer, AnySample, Estimate, FieldHeader, FieldSample, Grasp, Health, Outcome, SensorSample, Setpoint,
    State, Target, Valve, now_ns,
};

/// A summary of a sample; of a field never all values.
pub fn sample(sample: &AnySample) -> String {
    match sample {
        AnySample::Sensor(sample) => sensor(sample),
        AnySample::State(sample) => state(sample),
        AnySample::Health(sample) => health(sample),
        AnySample::Field(sample) => field(sample),
        AnySample::Grasp(sample) => numbered_grasp(sample),
        AnySample::Estimate(sample) => estimate(sample),
        AnySample::Command(sample) => format!("#{:<7} P wanted {:8.5} MPa", sample.seq, sample.pressure_mpa),
        AnySample::Setpoint(sample) | AnySample::Override(sample) => setpoint(sample),
        AnySample::Target(sample) => target(sample),
        AnySample::Valve(sample) => valve(sample),
    }
}

fn setpoint(sample: &Setpoint) -> String {
    let Setpoint { seq, pressure_mpa, valid_for_ns, .. } = sample;
    let wanted =
        if pressure_mpa.is_nan() { "released".into() } else { format!("P wanted {pressure_mpa:8.5} MPa") };
    let valid = if *valid_for_ns == 0 { String::new() } else { format!(" for {}", ms(*valid_for_ns)) };
    format!("#{seq:<7} {wanted}{valid}, by {}", unpack_name(&sample.owner))
}

fn target(sample: &Target) -> String {
    let Target { seq, value_count, values, .. } = sample;
    let last = values.get((*value_count as usize).wrapping_sub(1)).copied().unwrap_or(f64::NAN);
    let kind = target_kind::as_str(sample.target_kind);
    format!("#{seq:<7} {kind} of {value_count} to {last:.5}, by {}", unpack_name(&sample.owner))
}

/// `#12  P 0.04000 MPa (following fc, wanted 0.04200, limited by rate)`.
pub fn valve(sample: &Valve) -> String {
    let list = |what: &str, names: Vec<&str>| match names.is_empty() {
        true => String::new(),
        false => format!("{what}{}", names.join(", ")),
    };
    format!(
        "#{:<7} P {:8.5} MPa ({}{}{}{}{})",
        sample.seq,
        sample.pressure_mpa,
        valve_reason::as_str(sample.valve_reason),
        list(": ", valve_interlock::names(sample.valve_interlock).collect()),
        list(", limited by ", valve_limit::names(sample.valve_limit).collect()),
        optional(", wanted", sample.wanted_mpa, "MPa"),
        list(
            ", by ",
            Some(unpack_name(&sample.owner)).iter().filter(|o| !o.is_empty()).map(String::as_str).collect()
        ),
    )
}

fn sensor(sample: &SensorSample) -> String {
    let status = if sample.status == 0 { String::new() } else { format!("  FAULT {}", sample.status) };
    let absent = |what: &str, bits: u32| match bits {
        0 => String::new(),
        _ => format!("  {what} {}", value_bits::names(bits).collect::<Vec<_>>().join(" ")),
    };
    let named: String = sample.inputs().map(|(name, value)| format!("  {name} {value:.5}")).collect();
    format!(
        "#{:<7} P {:8.5} MPa  gap {}{named}{}  age {}{status}{}{}",
        sample.seq,
        sample.pressure_mpa,
        gap(sample.gap_mm),
        optional("  measured", sample.measured_force_n, "N"),
        ms(now_ns().saturating_sub(sample.t_sensor_ns)),
        absent("TOO OLD", sample.stale_values),
        absent("FAULTY", sample.fault_values),
    )
}

fn state(state: &State) -> String {
    let outcome = Outcome::from_code(state.outcome).filter(|outcome| *outcome != Outcome::Published);
    format!(
        "#{:<7} {}{}{}{:7}{}{}{}  age {}{}{}",
        state.seq,
        inputs(state.pressure_mpa, state.gap_mm),
        not_measured(state.inputs()),
        parameter_list(state.inputs()),
        regime::as_str(state.regime),
        force(
            state.contact_force_n,
            state.force_halfwidth_n,
            [state.force_by_pressure_n_per_mpa, state.force_by_gap_n_per_mm]
        ),
        optional("  measured", state.measured_force_n, "N"),
        observed(state.observables()),
        ms(state.age_ns),
        flag_list(state.flags),
        outcome.map(|outcome| format!("  ({outcome})")).unwrap_or_default(),
    )
}

/// `  bending_angle_deg 46.210 +- 0.394`.
fn observed(observables: impl Iterator<Item = (String, f64, f64)>) -> String {
    let one = |(name, value, halfwidth): (String, f64, f64)| {
        let margin = if halfwidth.is_nan() { String::new() } else { format!(" +- {halfwidth:.3}") };
        format!("  {name} {value:.3}{margin}")
    };
    observables.map(one).collect()
}

fn estimate(estimate: &Estimate) -> String {
    let status = estimate_status::as_str(estimate.status);
    let (nis, rejected) = (estimate.nis, estimate.rejected_total);
    format!("#{:<7} {}  NIS {nis:.1} ({status}, {rejected} rejected)", estimate.seq, estimates(estimate))
}

/// `gap_mm 41.203 +- 0.180`; an unidentifiable value is marked; an alarm is named with its suspects.
pub fn estimates(estimate: &Estimate) -> String {
    let one = |index: usize| {
        let note = if estimate.identifiable & (1 << index) == 0 { " (not identifiable)" } else { "" };
        format!(
            "{} {:.5} +- {:.5}{note}",
            estimate.name(index),
            estimate.values[index],
            estimate.sigmas[index]
        )
    };
    let count = (estimate.unknown_count as usize).min(estimate.values.len());
    (0..count).map(one).chain(alarm(estimate)).collect::<Vec<_>>().join("  ")
}

fn alarm(estimate: &Estimate) -> Option<String> {
    let first = |named: &str| -> String {
        let bits = (0..u32::BITS).filter(|bit| estimate.suspects & (1 << bit) != 0);
        bits.map(|bit| format!(" {named} {bit}")).collect()
    };
    match estimate.alarm {
        estimate_alarm::NONE => None,
        estimate_alarm::INPUT if estimate.suspects == 1 => {
            Some("ALARM: the pressure read is not that in the actuator".into())
        }
        estimate_alarm::INPUT => Some(format!("ALARM: contradicted:{}", first("input"))),
        estimate_alarm::SENSOR if estimate.suspects == 1 => {
            Some("ALARM: the load cell is contradicted".into())
        }
        estimate_alarm::SENSOR => Some(format!("ALARM: contradicted (0 load cell):{}", first("marker"))),
        estimate_alarm::QUANTITY => {
            let names = (0..estimate.values.len()).filter(|at| estimate.suspects & (1 << at) != 0);
            let names: Vec<String> = names.map(|at| estimate.name(at)).collect();
            Some(format!("ALARM: far from what was known before: {}", names.join(", ")))
        }
        _ => Some("ALARM: the model does not explain the readings".into()),
    }
}

fn health(health: &Health) -> String {
    let us = |ns: u64| format!("{:.0} us", ns as f64 / 1e3);
    let counts = Outcome::ALL.iter().map(|outcome| (*outcome, health.count(*outcome)));
    let others: String = counts
        .filter(|(outcome, count)| *outcome != Outcome::Published && *count > 0)
        .map(|(outcome, count)| format!(", {count} {outcome}"))
        .collect();
    format!(
        "{:7.1} Hz  latency p50 {} p99 {} max {}  {} received, {} published{others}, {} never arrived{}",
        health.rate_hz,
        us(health.latency_p50_ns),
        us(health.latency_p99_ns),
        us(health.latency_max_ns),
        health.received,
        health.count(Outcome::Published),
        health.missed,
        flag_list(health.flags),
    )
}

fn field(sample: &FieldSample) -> String {
    let header = sample.header();
    let ranges: Vec<String> = header
        .fields()
        .filter_map(|id| {
            let (min, max) = range(sample.field(id)?);
            Some(format!("{} {min:.3}..{max:.3}", field_id::as_str(id)))
        })
        .collect();
    format!(
        "{}  {} nodes  {}{}",
        field_header(header),
        header.node_count,
        ranges.join("  "),
        flag_list(header.flags),
    )
}

/// Number, inputs, regime and force of a field.
pub fn field_header(header: &FieldHeader) -> String {
    format!(
        "#{:<7} {}{}{:7}{}",
        header.seq,
        inputs(header.pressure_mpa, header.gap_mm),
        parameter_list(header.inputs()),
        regime::as_str(header.regime),
        force(header.contact_force_n, f32::NAN, [f64::NAN; 2]),
    )
}

fn numbered_grasp(sample: &Grasp) -> String {
    let forces: Vec<String> = sample.fingers().map(|(force, _)| format!("{force:.4}")).collect();
    format!(
        "#{:<7} {}  F {} N  {:.1} g at friction {:.2}, safety {:.2}  margin {:+.0} %{}",
        sample.seq,
        grasp(sample),
        forces.join(" "),
        sample.mass_kg * 1e3,
        sample.friction,
        sample.safety,
        sample.margin * 100.0,
        flag_list(sample.flags),
    )
}

/// Grasp status, forces, and the pressure from which the object is held.
pub fn grasp(grasp: &Grasp) -> String {
    format!("{}, {}", grasp_status::as_str(grasp.grasp_status), grasp_forces(grasp))
}

/// Smallest and required force per finger, and the pressure at which to stop inflating.
pub fn grasp_forces(grasp: &Grasp) -> String {
    let stop = match grasp.stop_pressure_mpa {
        stop if stop.is_nan() => "no sampled pressure holds it".to_owned(),
        stop => format!("first held at {stop:.5} +- {:.5} MPa", grasp.stop_pressure_halfwidth_mpa),
    };
    let least = if grasp.least_force_n.is_nan() { "-".into() } else { format!("{:.3}", grasp.least_force_n) };
    format!("{least} of {:.3} N per finger, {stop}", grasp.needed_force_n)
}

/// An answer with its query, or the reason for its refusal.
pub fn answer(answer: &Answer) -> String {
    let head = format!("softtwin/{}/{}", unpack_name(&answer.actuator), query_kind::as_str(answer.kind));
    if let Some(reason) = answer.refusal() {
        return format!("{head}  no answer: {reason}");
    }
    let found = |name: &str, value: f64, unit: &str| {
        let (halfwidth, low, high) = (answer.uncertainty, answer.low, answer.high);
        format!("{name} = {value:.5} +- {halfwidth:.5} {unit} ({low:.5} .. {high:.5})  at ")
    };
    let entries = match answer.entries() {
        0 => String::new(),
        _ => format!("  field {} x {}", answer.field_count, answer.node_count),
    };
    format!(
        "{head}  {}{}{}{}{}{}{}{entries}{}  ({:.0} us)",
        match answer.kind {
            query_kind::PRESSURE => found("P", answer.pressure_mpa, "MPa"),
            query_kind::GAP => found("gap", answer.gap_mm, "mm"),
            _ => String::new(),
        },
        inputs(answer.pressure_mpa, answer.gap_mm),
        parameter_list(answer.inputs()),
        regime::as_str(answer.regime),
        force(
            answer.contact_force_n,
            answer.force_halfwidth_n,
            [answer.force_by_pressure_n_per_mpa, answer.force_by_gap_n_per_mm]
        ),
        observed(answer.observables()),
        optional("  onset", answer.onset_pressure_mpa, "MPa"),
        flag_list(answer.flags),
        answer.compute_ns as f64 / 1e3,
    )
}

/// Pressure and gap of a state, each followed by two blanks; empty for one that the model does not have.
fn inputs(pressure_mpa: f64, gap_mm: f64) -> String {
    let pressure = if pressure_mpa.is_nan() { String::new() } else { format!("P {pressure_mpa:8.5} MPa  ") };
    let gap = if gap_mm.is_nan() { String::new() } else { format!("gap {}  ", gap(gap_mm)) };
    pressure + &gap
}

fn gap(gap_mm: f64) -> String {
    if gap_mm.is_finite() { format!("{gap_mm:6.2} mm") } else { "none".into() }
}

/// Sources of pressure and gap if not measured: `(pressure_mpa estimated, gap_mm given)  `.
fn not_measured(inputs: impl Iterator<Item = InputValue>) -> String {
    let other = |input: &InputValue| {
        !input.is_parameter() && ![input_source::UNKNOWN, input_source::MEASURED].contains(&input.source)
    };
    let named = |input: InputValue| format!("{} {}", input.name, input_source::as_str(input.source));
    let notes = in_brackets(inputs.filter(other).map(named).collect());
    if notes.is_empty() { notes } else { format!("{}  ", notes.trim_start()) }
}

/// [`parameters`] between other values, followed by two blanks if there are any.
fn parameter_list(inputs: impl Iterator<Item = InputValue>) -> String {
    let list = parameters(inputs);
    if list.is_empty() { list } else { format!("{}  ", list.trim_start()) }
}

/// Inputs in addition to pressure and gap, with source and derivative of the force:
/// `  elastomer.law.mu_mpa 0.72 (given, dF 0.1234 N per unit)`.
pub fn parameters(inputs: impl Iterator<Item = InputValue>) -> String {
    let one = |InputValue { name, value, force_by, source }: InputValue| {
        let source = Some(source).filter(|source| *source != input_source::UNKNOWN);
        let gradient = Some(force_by).filter(|by| !by.is_nan()).map(|by| format!("dF {by:.4} N per unit"));
        let more = source.map(|source| input_source::as_str(source).to_owned()).into_iter().chain(gradient);
        format!("  {name} {value:.5}{}", in_brackets(more.collect()))
    };
    inputs.filter(InputValue::is_parameter).map(one).collect()
}

fn in_brackets(notes: Vec<String>) -> String {
    if notes.is_empty() { String::new() } else { format!(" ({})", notes.join(", ")) }
}

/// Contact force (N) with its half-width and its derivatives with respect to pressure and gap, where known, after two blanks; empty
/// without a force.
fn force(force_n: f64, halfwidth_n: f32, [by_pressure, by_gap]: [f64; 2]) -> String {
    if force_n.is_nan() {
        return String::new();
    }
    let halfwidth = if halfwidth_n.is_nan() { String::new() } else { format!(" +- {halfwidth_n:.4}") };
    format!(
        "  F {force_n:7.4}{halfwidth} N{}{}",
        optional("  dF/dP", by_pressure, "N/MPa"),
        optional("  dF/dgap", by_gap, "N/mm")
    )
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

/// Smallest and largest value, without NaN.
pub fn range(values: &[f32]) -> (f32, f32) {
    values
        .iter()
        .fold((f32::INFINITY, f32::NEG_INFINITY), |(min, max), value| (min.min(*value), max.max(*value)))
}

#[cfg(test)]
#[path = "../tests/unit/text.rs"]
mod tests;
