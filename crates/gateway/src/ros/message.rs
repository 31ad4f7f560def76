//! Samples as messages of ROS 2, in SI units.

use super::cdr::Cdr;
use wire::layout::{field_id, flags, unpack_name, valve_interlock, valve_limit, valve_reason};
use wire::{FieldHeader, Health, State, Valve};

/// Pascals per megapascal.
pub const PA_PER_MPA: f64 = 1e6;
/// `PointField.FLOAT32`.
const FLOAT32: u8 = 7;
/// Levels of `DiagnosticStatus`.
const OK: u8 = 0;
const WARN: u8 = 1;
const ERROR: u8 = 2;
const STALE: u8 = 3;

/// Force of the plate on the actuator, N, along y of the actuator's axes, in the frame of the contact; `None` without a force.
pub fn wrench(state: &State, actuator: &str, time_ns: u64) -> Option<Vec<u8>> {
    let force = [0.0, state.contact_force_n, 0.0, 0.0, 0.0, 0.0];
    let message = || Cdr::new().header(time_ns, &format!("{actuator}_contact")).doubles(&force).finish();
    (!state.contact_force_n.is_nan()).then(message)
}

/// Pressure of a state, Pa. Variance 0: unknown. `None` without a pressure.
pub fn pressure(state: &State, actuator: &str, time_ns: u64) -> Option<Vec<u8>> {
    let values = [state.pressure_mpa * PA_PER_MPA, 0.0];
    (!state.pressure_mpa.is_nan()).then(|| Cdr::new().header(time_ns, actuator).doubles(&values).finish())
}

/// Observables of a state by name, as positions in rad, m, 1/m and m3, with their half-widths as efforts; `None` without observables.
pub fn observables(state: &State, actuator: &str, time_ns: u64) -> Option<Vec<u8>> {
    let all: Vec<(String, f64, f64)> = state.observables().collect();
    if all.is_empty() {
        return None;
    }
    Some(joints(&all, &all.iter().map(|one| one.2 * per_unit(&one.0)).collect::<Vec<_>>(), actuator, time_ns))
}

/// Inputs of a state by name, as positions in Pa, m and what their names state: pressures of all cavities, the gap where there is one.
pub fn inputs(state: &State, actuator: &str, time_ns: u64) -> Option<Vec<u8>> {
    let known = state.inputs().filter(|input| input.value.is_finite());
    let all: Vec<(String, f64, f64)> = known.map(|input| (input.name, input.value, 0.0)).collect();
    (!all.is_empty()).then(|| joints(&all, &[], actuator, time_ns))
}

fn joints(all: &[(String, f64, f64)], efforts: &[f64], actuator: &str, time_ns: u64) -> Vec<u8> {
    let names: Vec<&str> = all.iter().map(|(name, ..)| name.as_str()).collect();
    let values: Vec<f64> = all.iter().map(|one| one.1 * per_unit(&one.0)).collect();
    let message =
        Cdr::new().header(time_ns, actuator).strings(&names).word(all.len() as u32).doubles(&values);
    message.word(0).word(efforts.len() as u32).doubles(efforts).finish()
}

/// SI units per unit at the end of a name; a pressure's may have its cavity behind it (`pressure_mpa.left`).
fn per_unit(name: &str) -> f64 {
    let name = if name.starts_with("pressure_mpa.") { "pressure_mpa" } else { name };
    let units =
        [("_deg", 1_f64.to_radians()), ("_per_mm", 1e3), ("_mm3", 1e-9), ("_mm", 1e-3), ("_mpa", PA_PER_MPA)];
    units.iter().find(|(end, _)| name.ends_with(end)).map_or(1.0, |(_, factor)| *factor)
}

/// Nodes of a field in m, with its other fields; `None` without x, y and z. `O(values)`.
pub fn points(header: &FieldHeader, values: &[f32], actuator: &str, time_ns: u64) -> Option<Vec<u8>> {
    let [x, y, z] = header.coordinates(values)?;
    let columns = header.columns(values);
    let others: Vec<(u8, &[f32])> =
        columns.filter(|(id, _)| ![field_id::X, field_id::Y, field_id::Z].contains(id)).collect();
    let named = |id: u8| match id {
        field_id::DISPLACEMENT => "displacement_mm".to_owned(),
        field_id::VON_MISES => "von_mises_mpa".to_owned(),
        other => format!("field_{other}"),
    };
    let names = ["x", "y", "z"].map(str::to_owned).into_iter().chain(others.iter().map(|(id, _)| named(*id)));
    let (step, nodes) = (4 * (3 + others.len()) as u32, x.len() as u32);
    let mut message = Cdr::new().header(time_ns, actuator).word(1).word(nodes).word(3 + others.len() as u32);
    for (offset, name) in (0..).step_by(4).zip(names) {
        message = message.string(&name).word(offset).byte(FLOAT32).word(1);
    }
    let mut data = Vec::with_capacity((step * nodes) as usize);
    for node in 0..nodes as usize {
        let place = [x, y, z].map(|column| column[node] * 1e-3);
        let all = place.into_iter().chain(others.iter().map(|(_, column)| column[node]));
        data.extend(all.flat_map(f32::to_le_bytes));
    }
    Some(message.byte(0).word(step).word(step * nodes).bytes(&data).byte(1).finish())
}

/// Health of a twin as one status.
pub fn diagnostics(health: &Health, actuator: &str, time_ns: u64) -> Vec<u8> {
    let set: Vec<&str> =
        flags::ALL.iter().filter(|flag| health.flags & flag.number != 0).map(|flag| flag.name).collect();
    let is_stale = health.flags & (flags::STALE | flags::NO_DATA) != 0;
    let level = if is_stale {
        STALE
    } else if set.is_empty() {
        OK
    } else {
        WARN
    };
    let summary = if set.is_empty() { "running".to_owned() } else { set.join(", ") };
    let values = [
        ("rate_hz", format!("{:.1}", health.rate_hz)),
        ("latency_p99_us", format!("{:.1}", health.latency_p99_ns as f64 * 1e-3)),
        ("received", health.received.to_string()),
        ("missed", health.missed.to_string()),
        ("late", health.late.to_string()),
    ];
    status(level, actuator, &summary, &values, time_ns)
}

/// A `DiagnosticArray` with one status.
fn status(level: u8, actuator: &str, summary: &str, values: &[(&str, String)], time_ns: u64) -> Vec<u8> {
    let message = Cdr::new().header(time_ns, "").word(1).byte(level);
    let message = message
        .string(&format!("softtwin: {actuator}"))
        .string(summary)
        .string(actuator)
        .word(values.len() as u32);
    values.iter().fold(message, |message, (key, value)| message.string(key).string(value)).finish()
}

/// Written and wanted pressure of a valve, Pa, as positions; NaN: no setpoint.
pub fn valve(valve: &Valve, actuator: &str, time_ns: u64) -> Vec<u8> {
    let values = [valve.pressure_mpa, valve.wanted_mpa].map(|mpa| mpa * PA_PER_MPA);
    let message = Cdr::new().header(time_ns, actuator).strings(&["pressure_written", "pressure_wanted"]);
    message.word(values.len() as u32).doubles(&values).word(0).word(0).finish()
}

/// Why a valve has this value as one status: 0 follows, 1 safe value or override, 2 device error.
pub fn valve_diagnostics(valve: &Valve, actuator: &str, time_ns: u64) -> Vec<u8> {
    let level = match valve.valve_reason {
        valve_reason::FOLLOWING => OK,
        valve_reason::DEVICE_ERROR => ERROR,
        _ => WARN,
    };
    let names = |all: wire::layout::Codes, bits: u32| -> String {
        let set = all.iter().filter(|one| bits & one.number != 0).map(|one| one.name);
        set.collect::<Vec<&str>>().join(", ")
    };
    let values = [
        ("interlocks", names(valve_interlock::ALL, valve.valve_interlock)),
        ("limits", names(valve_limit::ALL, valve.valve_limit)),
        ("owner", unpack_name(&valve.owner)),
    ];
    status(level, actuator, valve_reason::as_str(valve.valve_reason), &values, time_ns)
}

#[cfg(test)]
#[path = "../../tests/unit/message.rs"]
mod tests;
