//! The surface of a field as a `visualization_msgs/Marker`: a list of triangles in m, each corner coloured by its stress.

use super::cdr::Cdr;
use super::config::Ros2;
use runtime::known_model::KnownModel;
use std::sync::Arc;
use wire::layout::field_id;
use wire::{FieldHeader, Topic};

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
    pub fn of(topic: &Topic, ros: &Ros2) -> Option<Self> {
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
        let at = *corner as usize;
        points.extend([*x.get(at)?, *y.get(at)?, *z.get(at)?].map(|mm| f64::from(mm) * METRE));
        let [red, green, blue] = colour(stress.map_or(f32::NAN, |stress| stress[at] / full_scale_mpa));
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
#[path = "../../tests/unit/marker.rs"]
mod tests;
