//! Samples as messages of ROS 2, in SI units; the surface of a field as a `visualization_msgs/Marker`, each corner of its triangles
//! coloured by its stress.

use super::config::Ros2;
use super::wire_format::{Cdr, CdrReader};
use runtime::known_model::KnownModel;
use std::sync::Arc;
use wire::layout::{field_id, flags, unpack_name, valve_interlock, valve_limit, valve_reason};
use wire::{FieldHeader, FieldSample, Health, State, Topic, Valve};

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
    let observables: Vec<(String, f64, f64)> = state.observables().collect();
    let halfwidths: Vec<f64> =
        observables.iter().map(|(name, _, halfwidth)| halfwidth * per_unit(name)).collect();
    (!observables.is_empty()).then(|| joint_state(&observables, &halfwidths, actuator, time_ns))
}

/// Inputs of a state by name, as positions in Pa, m and what their names state: pressures of all cavities, the gap where there is one.
pub fn inputs(state: &State, actuator: &str, time_ns: u64) -> Option<Vec<u8>> {
    let known = state.inputs().filter(|input| input.value.is_finite());
    let inputs: Vec<(String, f64, f64)> = known.map(|input| (input.name, input.value, 0.0)).collect();
    (!inputs.is_empty()).then(|| joint_state(&inputs, &[], actuator, time_ns))
}

fn joint_state(values: &[(String, f64, f64)], efforts: &[f64], actuator: &str, time_ns: u64) -> Vec<u8> {
    let names: Vec<&str> = values.iter().map(|(name, ..)| name.as_str()).collect();
    let positions: Vec<f64> = values.iter().map(|(name, value, _)| value * per_unit(name)).collect();
    let message =
        Cdr::new().header(time_ns, actuator).strings(&names).word(names.len() as u32).doubles(&positions);
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
pub fn points(field: &FieldSample, actuator: &str, time_ns: u64) -> Option<Vec<u8>> {
    let (header, values) = (field.header(), field.values());
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
        let columns = place.into_iter().chain(others.iter().map(|(_, column)| column[node]));
        data.extend(columns.flat_map(f32::to_le_bytes));
    }
    Some(message.byte(0).word(step).word(step * nodes).bytes(&data).byte(1).finish())
}

/// Health of a twin as one status.
pub fn diagnostics(health: &Health, actuator: &str, time_ns: u64) -> Option<Vec<u8>> {
    let set: Vec<&str> = flags::names(health.flags).collect();
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
    Some(status(level, actuator, &summary, &values, time_ns))
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
pub fn valve(valve: &Valve, actuator: &str, time_ns: u64) -> Option<Vec<u8>> {
    let values = [valve.pressure_mpa, valve.wanted_mpa].map(|mpa| mpa * PA_PER_MPA);
    let message = Cdr::new().header(time_ns, actuator).strings(&["pressure_written", "pressure_wanted"]);
    Some(message.word(values.len() as u32).doubles(&values).word(0).word(0).finish())
}

/// Why a valve has this value as one status: 0 follows, 1 safe value or override, 2 device error.
pub fn valve_diagnostics(valve: &Valve, actuator: &str, time_ns: u64) -> Option<Vec<u8>> {
    let level = match valve.valve_reason {
        valve_reason::FOLLOWING => OK,
        valve_reason::DEVICE_ERROR => ERROR,
        _ => WARN,
    };
    let names = |all: wire::layout::Codes, bits: u32| -> String {
        let set = all.iter().filter(|code| bits & code.number != 0).map(|code| code.name);
        set.collect::<Vec<&str>>().join(", ")
    };
    let values = [
        ("interlocks", names(valve_interlock::ALL, valve.valve_interlock)),
        ("limits", names(valve_limit::ALL, valve.valve_limit)),
        ("owner", unpack_name(&valve.owner)),
    ];
    Some(status(level, actuator, valve_reason::as_str(valve.valve_reason), &values, time_ns))
}

/// Time (ns since 1970) and pressure (Pa) of a `sensor_msgs/FluidPressure`; `None` for other messages.
pub fn fluid_pressure(bytes: &[u8]) -> Option<(u64, f64)> {
    let mut reader = CdrReader::new(bytes)?;
    let (seconds, nanoseconds) = (reader.word()?, reader.word()?);
    reader.string()?;
    let time_ns = u64::from(seconds) * 1_000_000_000 + u64::from(nanoseconds);
    (nanoseconds < 1_000_000_000).then_some((time_ns, reader.double()?))
}

/// `Marker.TRIANGLE_LIST`.
const TRIANGLE_LIST: u32 = 11;
/// `Marker.ADD`.
const ADD: u32 = 0;
/// Metres per millimetre.
const METRE: f64 = 1e-3;
/// Colours at no stress, half and full scale, linear in between, with rising lightness.
const SCALE: [[f32; 3]; 3] = [[0.2, 0.1, 0.5], [0.1, 0.6, 0.6], [1.0, 0.9, 0.2]];
/// Colour beyond full scale.
const BEYOND: [f32; 3] = [0.9, 0.1, 0.1];
/// Colour without a stress.
const UNKNOWN: [f32; 3] = [0.5; 3];

/// Makes the markers of one field topic.
pub struct Markers {
    models: Arc<[KnownModel]>,
    node_set: Option<String>,
    full_scale_mpa: f32,
    /// Model and node count of the last field, and the indices of its triangles' corners; `None` if they cannot be drawn.
    last: Option<([u8; 16], u32, Option<Vec<u32>>)>,
}

impl Markers {
    /// Markers of a field topic; `None` unless it has the whole surface of a known model.
    pub fn for_topic(topic: &Topic, ros: &Ros2) -> Option<Self> {
        let node_set = topic.node_set();
        let is_known = ros.models.iter().any(|model| model.corners(node_set).is_some());
        is_known.then(|| Self {
            models: ros.models.clone(),
            node_set: node_set.map(str::to_owned),
            full_scale_mpa: ros.marker_full_scale_mpa as f32,
            last: None,
        })
    }

    /// The marker of a field; `None` for an unknown model. `O(triangles)`.
    pub fn encode(
        &mut self,
        header: &FieldHeader,
        values: &[f32],
        actuator: &str,
        time_ns: u64,
    ) -> Option<Vec<u8>> {
        let key = (header.model_hash, header.node_count);
        if self.last.as_ref().is_none_or(|(hash, count, _)| (*hash, *count) != key) {
            let found = self.corners(header);
            if found.is_none() {
                tracing::warn!("{actuator}: no marker: ros2.models has no file of its model");
            }
            self.last = Some((key.0, key.1, found));
        }
        let corners = self.last.as_ref()?.2.as_ref()?;
        marker(header, values, corners, self.full_scale_mpa, actuator, time_ns)
    }

    fn corners(&self, header: &FieldHeader) -> Option<Vec<u32>> {
        let node_set = self.node_set.as_deref();
        let model = self.models.iter().find(|model| model.hash == header.model_hash)?;
        let is_whole = model.nodes(node_set) == Some(header.node_count as usize);
        model.corners(node_set).filter(|_| is_whole)
    }
}

/// A `Marker` of triangles, given by their corners' indices in a field; `None` without x, y and z or with an index out of range.
fn marker(
    header: &FieldHeader,
    values: &[f32],
    corners: &[u32],
    full_scale_mpa: f32,
    actuator: &str,
    time_ns: u64,
) -> Option<Vec<u8>> {
    let [x, y, z] = header.coordinates(values)?;
    let stress = header.column(values, field_id::VON_MISES);
    let mut points = Vec::with_capacity(3 * corners.len());
    let mut colours = Vec::with_capacity(4 * corners.len());
    for corner in corners {
        let node = *corner as usize;
        points.extend([*x.get(node)?, *y.get(node)?, *z.get(node)?].map(|mm| f64::from(mm) * METRE));
        let [red, green, blue] = colour(stress.map_or(f32::NAN, |stress| stress[node] / full_scale_mpa));
        colours.extend([red, green, blue, 1.0]);
    }
    let message = Cdr::new().header(time_ns, actuator).string(actuator).word(0).word(TRIANGLE_LIST).word(ADD);
    // Pose: identity. Scale: 1.
    let message = message.doubles(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]).doubles(&[1.0; 3]);
    // Common colour (replaced by those of the corners), unlimited lifetime, fixed to its frame.
    let message = message.floats(&[1.0; 4]).word(0).word(0).byte(1);
    let message = message.word(corners.len() as u32).doubles(&points);
    let message = message.word(corners.len() as u32).floats(&colours);
    // No texture (name, header, format, data, coordinates), caption, mesh (name, file name, data, materials).
    let message = message.string("").header(0, "").string("").bytes(&[]).word(0).string("").string("");
    Some(message.string("").bytes(&[]).byte(0).finish())
}

/// The colour of a stress as a fraction of full scale.
fn colour(fraction: f32) -> [f32; 3] {
    if fraction.is_nan() {
        return UNKNOWN;
    }
    if fraction > 1.0 {
        return BEYOND;
    }
    let place = 2.0 * fraction.max(0.0);
    let (from, to) = if place < 1.0 { (SCALE[0], SCALE[1]) } else { (SCALE[1], SCALE[2]) };
    let along = if place < 1.0 { place } else { place - 1.0 };
    [0, 1, 2].map(|k| from[k] * (1.0 - along) + to[k] * along)
}

#[cfg(test)]
#[path = "../../tests/unit/message.rs"]
mod tests;
